"""The options of commands that run behaviors, and the specifications that they make."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any, TypeVar

import click

from colony.cli.outputs import BEHAVIOR
from colony.cli.params_choice import params_option
from colony.cli.robot_choice import robot_and_description_option
from colony.ir.program import Robot
from colony.ir.servers import DSERVER
from colony.ir.types import Value
from colony.runs.scenario import (
    GivenValueError,
    ReadingChange,
    Scenario,
    ScenarioError,
    UnknownSensorError,
    parse_number,
    read_scenario,
    setting,
)
from colony.runs.spec import MisuseError, RunSpec
from colony.text.units import ANGLE, LENGTH, TIME, nanoseconds

if TYPE_CHECKING:
    from colony.sim.world_spec import ViewDirection, WorldSpec

F = TypeVar("F", bound=Callable[..., object])
T = TypeVar("T")

DURATION = "60"
"""Default length in seconds of a simulated run without a goal."""


class OptionError(click.UsageError):
    """An option's value is invalid; the message has what was found and what was expected."""


# --- specifications ------------------------------------------------------------------------------


def run_spec(robot: Robot, options: Mapping[str, Any]) -> RunSpec:
    """Return the run that options request.

    An option whose name is that of a field of `RunSpec` or `WorldSpec` becomes this field.

    Raises:
        OptionError: an option's value is invalid.
        MisuseError: the scenario cannot be read.
    """
    pinned, given = held(robot, options.get("settings", ()))
    own = {field.name: options[field.name] for field in fields(RunSpec) if field.name in options}
    own |= {
        "world": world_spec(options),
        "pinned_variables": pinned,
        "scenario": scenario_of(robot, options.get("scenario"), given),
    }
    return RunSpec(**own)


def world_spec(options: Mapping[str, Any]) -> WorldSpec:
    """Return the world that options request; an option whose name is that of a field becomes this field."""
    from colony.sim.world_spec import WorldSpec

    return WorldSpec(**{name: options[name] for name in WorldSpec.__struct_fields__ if name in options})


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


# --- values --------------------------------------------------------------------------------------


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


# --- options -------------------------------------------------------------------------------------


def parsed(parse: Callable[[Any], T]) -> Callable[[click.Context, click.Parameter, Any], T | None]:
    """Return a callback for an option whose value is parsed if it is given."""
    return lambda context, option, value: None if value is None else parse(value)


behavior_argument = click.argument("file", metavar="FILE", type=BEHAVIOR)
"""The argument FILE, a behavior."""

robot_option = robot_and_description_option(
    "The name of the robot, if it differs from that in the program, and the description that `import robot` "
    "brings in: by default the one called NAME, else that of the project's colony.toml."
)
"""`--robot NAME[=DESCRIPTION]`."""

site_option = params_option("A contract that is proved without them must be proved with them, too.")
"""`--params SITE.toml`."""

start_option = click.option(
    "--start",
    metavar="X,Y,HEADING",
    callback=parsed(start_pose),
    help="Where the simulated robot starts: in mm and degrees counterclockwise from north, or with units. "
    "[default: the start of the map; in a grid 0,0,270, or the nearest place with room]",
)
"""`--start X,Y,HEADING`."""

MAX_MOVERS = 1_000

movers_option = click.option(
    "--movers",
    type=click.IntRange(0, MAX_MOVERS),
    metavar="N",
    default=0,
    help="Simulate N people who walk around between free places that the seed gives.",
)
"""`--movers N`."""

seed_option = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="The seed of all random numbers: `Runtime.random` and, of a simulated robot, the sensors' noise.",
)
"""`--seed N`."""

record_option = click.option(
    "--record",
    metavar="PATH",
    help="Record every frame into this file: *.mcap as MCAP, others as JSON lines.",
)
"""`--record PATH`."""

settings_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="Hold what the program reads at this value: a variable of DServer, as if an operator kept setting "
    "it, or a field of a device, such as a button. A number without a unit is in that of the sensor; one "
    "value fills an array. May be repeated.",
)
"""`--set NAME=VALUE`, as `settings`."""

scenario_option = click.option(
    "--scenario",
    metavar="FILE",
    type=click.Path(dir_okay=False),
    help="Change such values over time, from the beginning of the run: a file with lines such as `at 12 s "
    "estop = true`.",
)
"""`--scenario FILE`."""

origin_option = click.option(
    "--from",
    "origin",
    metavar="ROOM",
    help="With --to: the room where the robot starts, by its name on the map.",
)
"""`--from ROOM`, as `origin`."""

goal_option = click.option(
    "--to", "goal", metavar="ROOM", help="With --from: the goal; the run ends when the robot has arrived."
)
"""`--to ROOM`, as `goal`."""

unproved_option = click.option(
    "--unproved",
    is_flag=True,
    help="With --params: run even if contracts are not proved with these values; the recording says so.",
)
"""`--unproved`."""

watch_option = click.option(
    "--watch",
    is_flag=True,
    help="Show the run in the browser as long as it lasts, in real time; see `colony watch`.",
)
"""`--watch`."""

format_option = click.option(
    "--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True
)
"""`--format text|json`, as `format_`."""


def duration_option(default: str) -> Callable[[F], F]:
    """Return the option `--duration TIME`, as `length_ns`; `default` describes what holds without it."""
    return click.option(
        "--duration",
        "length_ns",
        metavar="TIME",
        callback=parsed(duration_ns),
        help=f"The length of the run: {DURATION} (in seconds), 90s or 2min. [default: {default}]",
    )


def camera_option(where: str = "") -> Callable[[F], F]:
    """Return the option `--camera [NAME=]DEGREES|up`, as `cameras`; its help begins with `where`."""
    add = "add" if where else "Add"
    return click.option(
        "--camera",
        "cameras",
        multiple=True,
        metavar="[NAME=]DEGREES|up",
        callback=parsed(cameras),
        help=f"{where}{add} a camera facing this direction, in degrees counterclockwise from straight ahead, "
        "or facing up. May be repeated.",
    )


def expect_both_ends(options: Mapping[str, Any]) -> None:
    """Raise OptionError if `--from` or `--to` is given alone."""
    if (options["origin"] is None) != (options["goal"] is None):
        found = "--to" if options["origin"] is None else "--from"
        raise OptionError(f"found {found} alone; expected --from ROOM --to ROOM")
