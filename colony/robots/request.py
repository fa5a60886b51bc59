"""What a run is asked to be, who attends it, and what came of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from colony.ir.types import Value
from colony.runtime.observe.observer import Sink
from colony.runtime.observe.summary import RunSummary

if TYPE_CHECKING:
    from colony.nav.maps.building import Building
    from colony.nav.maps.stickrep.model import Map
    from colony.runtime.kit.script import Script
    from colony.sim.plant.child import Look


class Misuse(Exception):
    """What was named cannot be used; the message is one line that begins with it."""


class BrokenOff(Exception):
    """A run of processes could not begin, or broke off; the message, of one line or several, tells why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRequest:
    """The run that is wanted.

    Attributes:
        file: the behavior, as it is named to people.
        map_path: the building; None where the robot is there already.
        seed: of chance and of the sensors' noise.
        length_ns: the length of the run; None for one until it is interrupted, or its way is done.
        held: variables of DServer, held as fresh as each frame.
        realtime: a run in virtual time keeps pace with the wall clock.
        record: the file of the recording, if there is to be one.
        cameras: servers of cameras, each with where it looks; of processes only.
        isolate: run each client in its own process; only for runs of several processes.
        fsync: DServer's data outlives a loss of power; of processes only.
        origin, goal: the rooms of the way to drive, if there is one.
        hazards: the seed of what goes wrong in the building; None for nothing.
    """

    file: str
    map_path: str | None
    seed: int
    length_ns: int | None
    held: Mapping[str, Value]
    realtime: bool = False
    record: str | None = None
    cameras: Mapping[str, Look]
    fsync: bool = False
    isolate: bool = False
    origin: str | None = None
    goal: str | None = None
    hazards: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Attendant:
    """Whoever started a run: hears of it, and may end it.

    Attributes:
        report: told what happens, a line or several; also from other threads.
        interruptible: returns a context that lasts as long as the run may be interrupted, and gives the
            function that tells whether it was.
        progress: returns a sink that follows a run of so many nanoseconds, None: of one without an end.
        operator: returns a script that presses the buttons of a building's elevators.
    """

    report: Callable[[str], None]
    interruptible: Callable[[], AbstractContextManager[Callable[[], bool]]]
    progress: Callable[[int | None], Sink]
    operator: Callable[[Building], Script]


class Arrival(NamedTuple):
    """Whether a robot that was sent somewhere arrived, what to say of it, and the files in which its way on
    other floors than the first is drawn.
    """

    arrived: bool
    text: str
    pictures: tuple[str, ...] = ()


class Driven(NamedTuple):
    """What came of a run, and of its way if there was one; of a simulated robot also the floors, and where it
    really was on each, in mm.
    """

    summary: RunSummary
    arrival: Arrival | None
    floors: tuple[Map, ...] = ()
    places: Mapping[str, Sequence[tuple[float, float]]] = {}
