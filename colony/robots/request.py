"""The request for a run, its user interface, and its result."""

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
    from colony.sim.plant.child import ViewDirection


class MisuseError(Exception):
    """An input cannot be used; the message is one line that begins with the name of the input."""


class RunAbortedError(Exception):
    """A run could not begin, or broke off; the message, of one line or several, has the reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRequest:
    """The request for a run.

    Attributes:
        file: the file of the behavior, as the user named it.
        map_path: the map of the building; None for a robot that is already running.
        seed: the seed of chance and of the sensors' noise.
        length_ns: the length of the run; None to run until it is interrupted, or its route is done.
        held: variables of DServer that are kept at these values, and fresh in each frame.
        realtime: True to run in virtual time no faster than the wall clock.
        record: the file of the recording; None for no recording.
        cameras: servers of cameras with their viewing directions; for runs of several processes.
        isolate: True to run each client in its own process; for runs of several processes.
        fsync: True to make DServer's data survive a power failure; for runs of several processes.
        origin: the room where the route begins; None for no route.
        goal: the room where the route ends; None for no route.
        hazards: the seed of the building's hazards; None for none.
    """

    file: str
    map_path: str | None
    seed: int
    length_ns: int | None
    held: Mapping[str, Value]
    realtime: bool = False
    record: str | None = None
    cameras: Mapping[str, ViewDirection]
    fsync: bool = False
    isolate: bool = False
    origin: str | None = None
    goal: str | None = None
    hazards: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class UserInterface:
    """The user interface of a run, which receives its reports and may interrupt it.

    Attributes:
        report: takes the description of an event, of one line or several, from any thread.
        interruptible: returns a context in which the run may be interrupted; its value is a function that
            returns True if it was.
        progress: returns a sink that shows the progress of a run of so many nanoseconds; None for a run
            without a fixed length.
        operator: returns a script that presses the buttons of a building's elevators.
    """

    report: Callable[[str], None]
    interruptible: Callable[[], AbstractContextManager[Callable[[], bool]]]
    progress: Callable[[int | None], Sink]
    operator: Callable[[Building], Script]


class MissionResult(NamedTuple):
    """The result of a mission: `arrived`, a text for people, and the pictures of the other floors."""

    arrived: bool
    text: str
    pictures: tuple[str, ...] = ()


class RunReport(NamedTuple):
    """The result of a run, and of its mission if there was one.

    For a simulated robot it also has the floors, and the robot's true places on each floor, in mm.
    """

    summary: RunSummary
    mission_result: MissionResult | None
    floors: tuple[Map, ...] = ()
    places: Mapping[str, Sequence[tuple[float, float]]] = {}
