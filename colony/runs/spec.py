"""The specification of a run, its user interface, and its result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from colony.body.model import Body
from colony.ir.types import Value
from colony.nav.maps.driven_path import Paths
from colony.runtime.observe.comparison import ControllerReport
from colony.runtime.observe.observer import Sink
from colony.runtime.observe.summary import RunSummary

if TYPE_CHECKING:
    from colony.ir.program import Program
    from colony.nav.maps.building import Building
    from colony.nav.maps.world_map import WorldMap
    from colony.runs.described import DescribedRobot
    from colony.runs.scenario import Scenario
    from colony.runtime.kit.script import Script
    from colony.sim.world_spec import WorldSpec


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
class RunSpec:
    """The specification of a run.

    Attributes:
        file: the file of the behavior, as the user named it.
        robot: the name of the robot; None for that of its description.
        world: the world of the robot, and the seed of the run.
        length_ns: the length of the run; None to run until it is interrupted, or its route is done.
        pinned_variables: variables of DServer, with the values at which they are kept; they are fresh in
            every frame.
        scenario: what else the program reads that nobody simulates.
        physics: what moves the robot: our simulator, or MuJoCo.
        realtime: True to run in virtual time no faster than the wall clock.
        record: the file of the recording; None for no recording.
        isolate: True to run each server in its own process, and the clients in another one.
        fsync: True to make DServer's data survive a power failure; for runs in several processes.
        origin: the room where the route begins; None for no route.
        goal: the room where the route ends; None for no route.
        others: the other robots of a simulated world; for runs in one process.
    """

    file: str
    robot: str | None = None
    world: WorldSpec
    length_ns: int | None = None
    pinned_variables: Mapping[str, Value] = field(default_factory=dict)
    scenario: Scenario | None = None
    physics: PhysicsName = "kinematic"
    realtime: bool = False
    record: str | None = None
    isolate: bool = False
    fsync: bool = False
    origin: str | None = None
    goal: str | None = None
    others: tuple[OtherRobot, ...] = ()

    def with_world(self, **changes: Any) -> RunSpec:
        """Return the same run with other values of fields of its world."""
        return replace(self, world=self.world.changed(**changes))


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
        stands: function that reports why nothing moves; by default nobody is interested.
    """

    report: Callable[[str], None]
    interruptible: Callable[[], AbstractContextManager[Callable[[], bool]]]
    progress: Callable[[int | None], Sink]
    operator: Callable[[Building], Script]
    sinks: tuple[Sink, ...] = ()
    stands: Callable[[str], None] = lambda line: None


class MissionResult(NamedTuple):
    """The result of a mission: True if the robot arrived, a text for people, and pictures of other floors."""

    arrived: bool
    text: str
    pictures: tuple[str, ...] = ()


class RunReport(NamedTuple):
    """The result of a run, and of its mission if there was one.

    For a simulated robot it also has the floors, and the robot's true path on each floor, in mm, and the true
    paths of other robots by name, on the only floor, and those of the people on each floor. In virtual time
    it has the place in mm and the time in s of each contact, and its longest stay in s (see `LongestStay`).
    For a shadow it has the comparison with the controller that drives the robot, if that is heard.
    """

    summary: RunSummary
    mission_result: MissionResult | None
    floors: tuple[WorldMap, ...] = ()
    paths: Mapping[str, Sequence[tuple[float, float]]] = {}
    other_paths: Mapping[str, Sequence[tuple[float, float]]] = {}
    people: Mapping[str, Paths] = {}
    contacts: tuple[tuple[float, float], ...] = ()
    longest_stay_s: float = 0.0
    controller: ControllerReport | None = None
    contact_s: tuple[float, ...] = ()


def expect_simulable(physics: PhysicsName, body: Body, file: str) -> None:
    """Raise MisuseError if a physics does not simulate what a robot has.

    Args:
        physics: the physics of the run.
        body: the body of its robot.
        file: the file of the behavior, which the message names.

    Raises:
        MisuseError: the robot cannot be simulated.
    """
    if physics != "mujoco":
        return
    from colony.sim.mujoco.model import build_of

    try:
        build_of(body)
    except ValueError as problem:
        text = f"`{body.robot.name}` cannot be simulated: {problem}"
        raise MisuseError(f"{file}: error: {text}") from None
