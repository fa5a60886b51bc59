"""The request for a run, its user interface, and its result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

from colony.ir.types import Value
from colony.robots.driven_path import Paths
from colony.runtime.observe.observer import Sink
from colony.runtime.observe.summary import RunSummary

if TYPE_CHECKING:
    from colony.ir.program import Program
    from colony.nav.maps.building import Building
    from colony.nav.maps.world_map import WorldMap
    from colony.robots.described import DescribedRobot
    from colony.robots.scenario import Scenario
    from colony.runtime.kit.script import Script
    from colony.sim.plant.child import ViewDirection


PhysicsName = Literal["kinematic", "mujoco"]
"""The name of a physics that moves simulated robots (docs/physics.md)."""


class MisuseError(Exception):
    """An input is invalid; the message is one line that begins with the name of the input."""


class RunAbortedError(Exception):
    """A run could not begin, or broke off; the message, of one line or several, has the reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherRobot:
    """Another robot of a simulated world.

    Attributes:
        name: its name, different from those of the others.
        file: the file of its behavior.
        described: the robot, as its description has it.
        program: its behavior, checked against this description.
        start: its initial pose, x and y in mm and the heading in degrees; None for a free one.
        scenario: what it reads that nobody simulates.
    """

    name: str
    file: str
    described: DescribedRobot
    program: Program
    start: tuple[float, float, float] | None = None
    scenario: Scenario | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRequest:
    """The request for a run.

    Attributes:
        file: the file of the behavior, as the user named it.
        robot: the name of the robot; None for that of its description.
        map_path: the map of the building; None for a robot that is already running.
        seed: the seed of all random numbers, such as the sensors' noise.
        length_ns: the length of the run; None to run until it is interrupted, or its route is done.
        pinned_variables: variables of DServer, with the values at which they are kept; they are fresh in
            every frame.
        scenario: what else the program reads that nobody simulates.
        physics: what moves the robot: our simulator, or MuJoCo.
        realtime: True to run in virtual time no faster than the wall clock.
        record: the file of the recording; None for no recording.
        cameras: viewing directions of cameras by server name; for runs in several processes.
        isolate: True to run each client in its own process; for runs in several processes.
        fsync: True to make DServer's data survive a power failure; for runs in several processes.
        origin: the room where the route begins; None for no route.
        goal: the room where the route ends; None for no route.
        hazards: the seed of the building's hazards; None for no hazards.
        start: x and y in mm and the heading in degrees where a simulated robot starts; None for the map's.
        movers: the number of people who walk around in a simulated world, besides those of hazards.
        others: the other robots of a simulated world; for runs in one process.
    """

    file: str
    map_path: str | None
    seed: int
    length_ns: int | None
    pinned_variables: Mapping[str, Value]
    robot: str | None = None
    scenario: Scenario | None = None
    physics: PhysicsName = "kinematic"
    realtime: bool = False
    record: str | None = None
    cameras: Mapping[str, ViewDirection]
    fsync: bool = False
    isolate: bool = False
    origin: str | None = None
    goal: str | None = None
    hazards: int | None = None
    start: tuple[float, float, float] | None = None
    movers: int = 0
    others: tuple[OtherRobot, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class UserInterface:
    """The user interface of a run, which receives its reports and may interrupt it.

    Attributes:
        report: function that reports an event, in one line or several; may be called from any thread.
        interruptible: function that returns a context in which the run may be interrupted. The context's
            value is a function that returns True after an interruption.
        progress: function that returns a sink, which shows the progress of a run. Its argument is the length
            of the run in nanoseconds, or None if it is not fixed.
        operator: function that returns a script, which presses the buttons of a building's elevators.
        sinks: what else gets every frame, in the robot's own time.
    """

    report: Callable[[str], None]
    interruptible: Callable[[], AbstractContextManager[Callable[[], bool]]]
    progress: Callable[[int | None], Sink]
    operator: Callable[[Building], Script]
    sinks: tuple[Sink, ...] = ()


class MissionResult(NamedTuple):
    """The result of a mission: True if the robot arrived, a text for people, and pictures of other floors."""

    arrived: bool
    text: str
    pictures: tuple[str, ...] = ()


class RunReport(NamedTuple):
    """The result of a run, and of its mission if there was one.

    For a simulated robot it also has the floors, and the robot's true path on each floor, in mm, and the true
    paths of other robots by name, on the only floor, and those of the people on each floor. In virtual time
    it has the robot's place in mm at each contact, too, and its longest stay in seconds (see `LongestStay`).
    """

    summary: RunSummary
    mission_result: MissionResult | None
    floors: tuple[WorldMap, ...] = ()
    paths: Mapping[str, Sequence[tuple[float, float]]] = {}
    other_paths: Mapping[str, Sequence[tuple[float, float]]] = {}
    people: Mapping[str, Paths] = {}
    contacts: tuple[tuple[float, float], ...] = ()
    longest_stay_s: float = 0.0
