"""The request for a run, the attendant who started it, and its result."""

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


class MisuseError(Exception):
    """A named input cannot be used; the message is one line that begins with its name."""


class RunAbortedError(Exception):
    """A run of processes could not begin, or broke off; the message, of one line or several, says why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRequest:
    """The request for a run.

    Attributes:
        file: the behavior, by its name for people.
        map_path: the building; None for a robot that runs already.
        seed: the seed of chance and of the sensors' noise.
        length_ns: the length of the run; None for one until it is interrupted, or its way is done.
        held: variables of DServer, held as fresh as each frame.
        realtime: True to keep a run in virtual time at the pace of the wall clock.
        record: the file of the recording; None for no recording.
        cameras: servers of cameras with their viewing directions; for runs of several processes.
        isolate: True to run each client in its own process; for runs of several processes.
        fsync: True to make DServer's data survive a loss of power; for runs of several processes.
        origin: the room where the way begins; None for no way.
        goal: the room where the way ends; None for no way.
        hazards: the seed of the building's hazards; None for none.
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
    """The attendant of a run: it receives the run's reports, and may end it.

    Attributes:
        report: takes a description of each event, of one line or several; also from other threads.
        interruptible: returns a context in which the run may be interrupted; its value is a function that
            returns True if it was.
        progress: returns a sink that follows a run of so many nanoseconds; None for one without an end.
        operator: returns a script that presses the buttons of a building's elevators.
    """

    report: Callable[[str], None]
    interruptible: Callable[[], AbstractContextManager[Callable[[], bool]]]
    progress: Callable[[int | None], Sink]
    operator: Callable[[Building], Script]


class Arrival(NamedTuple):
    """The result of a way: `arrived`, a text for people, and the pictures of the other floors."""

    arrived: bool
    text: str
    pictures: tuple[str, ...] = ()


class Driven(NamedTuple):
    """The result of a run, and of its way if there was one.

    For a simulated robot it also has the floors, and the robot's true places on each, in mm.
    """

    summary: RunSummary
    arrival: Arrival | None
    floors: tuple[Map, ...] = ()
    places: Mapping[str, Sequence[tuple[float, float]]] = {}
