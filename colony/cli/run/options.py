"""The values of the options of `colony run`: durations, cameras, and DServer's variables."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from colony.cli.robot_options import HERE
from colony.ir.program import Robot
from colony.ir.servers import DSERVER
from colony.ir.types import Value
from colony.robots.given_values import GivenValueError, UnknownSensorError, parse_number
from colony.robots.request import MisuseError, PhysicsName, RunRequest
from colony.robots.scenario import ReadingChange, Scenario, ScenarioError, read_scenario, setting
from colony.text.units import ANGLE, LENGTH, TIME, nanoseconds

if TYPE_CHECKING:
    from colony.sim.plant.child import ViewDirection

DURATION = "60"
"""Default length in seconds of a run in a building."""


class OptionError(ValueError):
    """An option's value is invalid; the message has what was found and what was expected."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """The command line of `colony run`, as given."""

    file: str
    map_path: str | None
    processes: bool
    connect: str | None
    shadow: bool
    security: Path | None
    robot: str | None
    physics: PhysicsName | None
    seed: int
    duration: str | None
    realtime: bool
    record: str | None
    picture: str | None
    no_picture: bool
    settings: tuple[str, ...]
    scenario: str | None
    cameras: tuple[str, ...]
    origin: str | None
    goal: str | None
    hazards: int | None
    start: str | None
    movers: int
    also: tuple[str, ...]
    fsync: bool
    isolate: bool
    unproved: bool
    watch: bool
    format_: Literal["text", "json"]


def request_of(robot: Robot, options: Options) -> RunRequest:
    """Return the run that the options request.

    Raises:
        OptionError: an option's value is invalid.
        MisuseError: the scenario cannot be read.
    """
    pinned, given = held(robot, options.settings)
    is_open_ended = options.shadow or options.connect is not None or options.goal is not None
    duration = options.duration or (None if is_open_ended else DURATION)
    return RunRequest(
        file=options.file,
        robot=options.robot,
        map_path=options.map_path,
        seed=options.seed,
        length_ns=None if duration is None else duration_ns(duration),
        pinned_variables=pinned,
        scenario=scenario_of(robot, options.scenario, given),
        physics=options.physics or "kinematic",
        realtime=options.realtime,
        record=options.record,
        cameras=cameras(options.cameras),
        fsync=options.fsync,
        isolate=options.isolate,
        origin=options.origin,
        goal=options.goal,
        hazards=options.hazards,
        start=None if options.start is None else start_pose(options.start),
        movers=options.movers,
    )


def scenario_of(robot: Robot, path: str | None, given: Iterable[ReadingChange] = ()) -> Scenario:
    """Return the scenario in a file, if there is one, after other changes.

    Raises:
        MisuseError: the file cannot be read, or is no scenario for this robot.
    """
    try:
        changes = () if path is None else read_scenario(path, robot).changes
    except ScenarioError as problem:
        raise MisuseError(str(problem)) from None
    return Scenario((*given, *changes))


def held(robot: Robot, settings: tuple[str, ...]) -> tuple[dict[str, Value], list[ReadingChange]]:
    """Return what the texts of `--set` hold: DServer's variables, in declared units, and other fields.

    Raises:
        OptionError: a text is not of the form `NAME=VALUE`, or the program reads no such value.
    """
    variables: dict[str, Value] = {}
    others: list[ReadingChange] = []
    for text in settings:
        try:
            change = setting(robot, text)
        except UnknownSensorError as problem:
            raise OptionError(f"--set: {problem}; a param is set by --params FILE") from None
        except GivenValueError as problem:
            raise OptionError(f"--set: {problem}") from None
        if change.value is not None and change.sensor.server == DSERVER.name:
            variables[change.sensor.field] = change.value
        else:
            others.append(change)
    return variables, others


def objection(options: Options) -> str | None:
    """Return the reason why the options cannot be combined; None if they can."""
    if options.shadow:
        return _objection_to_shadow(options)
    connected, mapped = options.connect is not None, options.map_path is not None
    has_goal = options.goal is not None
    if not connected and not mapped:
        return "no robot: give --map MAP to simulate one or --connect to join a running one"
    if connected and options.processes:
        return "--connect and --processes exclude each other: the robot is already running"
    if connected and mapped and not has_goal:
        return "--connect takes --map only with --from and --to: the robot is already running"
    if connected and not mapped and has_goal:
        return "--to requires --map MAP, the building to drive through"
    if not connected and options.security is not None:
        return "--security requires --connect"
    if options.realtime and connected:
        return "--realtime is for a simulated run: a running robot always runs in real time"
    if options.isolate and not (options.processes or connected):
        return "--isolate requires --processes or --connect"
    if not options.processes and (options.cameras or options.fsync):
        return f"{'--camera' if options.cameras else '--fsync'} requires --processes"
    if (options.origin is None) != (options.goal is None):
        return f"found {'--to' if options.origin is None else '--from'} alone; expected --from ROOM --to ROOM"
    if options.start is not None and (connected or has_goal):
        return "--start is for a simulated robot without --from and --to, which begins a route elsewhere"
    if not has_goal and options.hazards is not None:
        return "--hazards requires --from and --to"
    if connected and options.hazards is not None:
        return "--hazards cannot be combined with --connect: give it to `colony serve`"
    return _objection_to_physics(options) or _objection_to_company(options)


_RUNNING = "the robot is already running, and --shadow reads it as it is"
_COMMANDS = "--shadow sets and commands nothing"
_IN_SHADOW: tuple[tuple[str, str], ...] = (
    ("map_path", f"--map: {_RUNNING}"),
    ("processes", f"--processes: {_RUNNING}"),
    ("realtime", f"--realtime: {_RUNNING}"),
    ("watch", "--watch: `colony watch --robot NAME` shows a robot that is running"),
    ("physics", f"--physics: {_RUNNING}"),
    ("cameras", f"--camera: {_RUNNING}"),
    ("fsync", f"--fsync: {_RUNNING}"),
    ("hazards", f"--hazards: {_RUNNING}"),
    ("start", f"--start: {_RUNNING}"),
    ("movers", f"--movers: {_RUNNING}"),
    ("also", f"--also: {_RUNNING}"),
    ("settings", f"--set: {_COMMANDS}; `colony data set` sets a variable of the robot"),
    ("scenario", f"--scenario: {_COMMANDS}; `colony data set` sets a variable of the robot"),
    ("origin", f"--from: {_COMMANDS}, and a planner would"),
    ("goal", f"--to: {_COMMANDS}, and a planner would"),
    ("isolate", "--isolate: the clients of --shadow are in this process, where they can disturb nobody"),
    ("picture", "--picture: the path is not that of this program; draw frames with `colony trace --picture`"),
)
"""Fields of `Options` that do not go with `--shadow`, and why not."""


def _objection_to_shadow(options: Options) -> str | None:
    for name, reason in _IN_SHADOW:
        if getattr(options, name) not in (None, False, (), 0) or (name == "hazards" and options.hazards == 0):
            return f"--shadow cannot be combined with {reason}"
    if options.connect in (None, HERE) and options.security is not None:
        return "--security requires --connect tls/HOST:PORT"
    return None


def _objection_to_physics(options: Options) -> str | None:
    if options.physics is not None and (options.connect is not None or options.processes):
        return "--physics requires --map without --processes or --connect: it is for runs in virtual time"
    if options.physics == "mujoco" and options.goal is not None:
        return "--physics mujoco excludes --to: MuJoCo simulates no sonars, cameras and elevators"
    if options.physics == "mujoco" and (options.movers or options.also):
        return "--physics mujoco excludes --movers and --also: MuJoCo simulates one robot"
    return None


def _objection_to_company(options: Options) -> str | None:
    """Return the reason why people and other robots cannot be in the run; None if they can."""
    for option, is_given in (("--movers", options.movers > 0), ("--also", bool(options.also))):
        if is_given and options.connect is not None:
            return f"{option} cannot be combined with --connect: the robot is already running"
        if is_given and options.goal is not None:
            return f"{option} cannot be combined with --from and --to; --hazards has people in the corridors"
    if options.also and options.processes:
        return "--also cannot be combined with --processes: other robots run in virtual time"
    return None


def duration_ns(text: str, *, option: str = "--duration") -> int:
    """Parse a duration such as `60`, in seconds, or with a unit, `2 min`; return it in nanoseconds.

    Raises:
        OptionError: the text is not a duration above 0.
    """
    seconds = parse_number(text, TIME, 1.0)
    if seconds is None or not 0.0 < seconds <= 1e9 or not nanoseconds(seconds):
        raise OptionError(
            f"{option}: found `{text}`; expected a time above 0 and at most 1e9 s, such as 60 or 2min"
        )
    return nanoseconds(seconds)


_FARTHEST_MM = 1e8
"""The largest coordinate of a start, as in maps."""


def start_pose(text: str, *, option: str = "--start") -> tuple[float, float, float]:
    """Parse a pose `X,Y,HEADING`, in mm and degrees or with units: `1.5m, 2m, 90`.

    Raises:
        OptionError: the text is not such a pose.
    """
    parts = text.split(",")
    if len(parts) == 3:
        x, y = (parse_number(part, LENGTH, 1.0) for part in parts[:2])
        heading = parse_number(parts[2], ANGLE, 1.0)
        if x is not None and y is not None and heading is not None and max(abs(x), abs(y)) <= _FARTHEST_MM:
            return x, y, heading % 360.0
    form = "X,Y,HEADING, in mm and degrees counterclockwise from north: 1500,2000,90 or 1.5m,2m,90"
    expected = f"{form}, up to 100 km"
    raise OptionError(f"{option}: found `{text}`; expected {expected}")


MAX_CAMERAS = 8


def cameras(texts: tuple[str, ...]) -> dict[str, ViewDirection]:
    """Parse cameras; return their viewing directions by server name.

    A direction is `up`, or degrees counterclockwise from ahead. A text is a direction, or a name and a
    direction: `left=90`, `CServerUp=up`. The server of a camera without a name is `CServer`, that of a camera
    with a name `CServer_name`, unless the name already begins with `CServer`.

    Raises:
        OptionError: a text is not of this form, or two cameras have the same name.
    """
    directions: dict[str, ViewDirection] = {}
    for text in texts:
        name, equals, direction = text.rpartition("=")
        view = _view_direction(direction)
        if view is None or (equals and not name.isidentifier()):
            expected = "degrees, `up`, or a name and one of these: left=90"
            raise OptionError(f"--camera: found `{text}`; expected {expected}")
        server = name if name.startswith("CServer") else f"CServer_{name}" if name else "CServer"
        if server in directions:
            raise OptionError(
                f"--camera: two cameras are named `{name}`" if name else "--camera: two cameras have no name"
            )
        directions[server] = view
    if len(directions) > MAX_CAMERAS:
        raise OptionError(f"--camera: found {len(directions)} cameras; expected at most {MAX_CAMERAS}")
    return directions


def _view_direction(text: str) -> ViewDirection | None:
    if text.strip() == "up":
        return "up"
    yaw = parse_number(text, ANGLE, 1.0)
    return yaw if yaw is not None and abs(yaw) <= 360.0 else None
