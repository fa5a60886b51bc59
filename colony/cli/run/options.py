"""The values of the options of `colony run`: durations, cameras, and DServer's variables."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from colony.ir.program import Robot, Sensor
from colony.ir.types import Array, Bool, Enum, Quantity, Scalar, ScalarValue, Value
from colony.robots.request import RunRequest
from colony.runtime.protocol.bindings import name_hint
from colony.text.units import ANGLE, TIME, Dimension, UnitError, nanoseconds, parse_unit

if TYPE_CHECKING:
    from colony.sim.plant.child import ViewDirection

_QUANTITY = re.compile(r"([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*(.*)")


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
    security: Path | None
    robot: str | None
    seed: int
    duration: str | None
    realtime: bool
    record: str | None
    picture: str | None
    no_picture: bool
    settings: tuple[str, ...]
    cameras: tuple[str, ...]
    origin: str | None
    goal: str | None
    hazards: int | None
    fsync: bool
    isolate: bool
    unproved: bool
    format_: Literal["text", "json"]


def request_of(robot: Robot, options: Options) -> RunRequest:
    """Return the run that the options request.

    Raises:
        OptionError: an option's value is invalid.
    """
    is_open_ended = options.connect is not None or options.goal is not None
    duration = options.duration or (None if is_open_ended else DURATION)
    return RunRequest(
        file=options.file,
        map_path=options.map_path,
        seed=options.seed,
        length_ns=None if duration is None else duration_ns(duration),
        pinned_variables=variables(robot, options.settings),
        realtime=options.realtime,
        record=options.record,
        cameras=cameras(options.cameras),
        fsync=options.fsync,
        isolate=options.isolate,
        origin=options.origin,
        goal=options.goal,
        hazards=options.hazards,
    )


def objection(options: Options) -> str | None:
    """Return the reason why the options cannot be combined; None if they can."""
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
    if not has_goal and options.hazards is not None:
        return "--hazards requires --from and --to"
    if connected and options.hazards is not None:
        return "--hazards cannot be combined with --connect: give it to `colony serve`"
    return None


def duration_ns(text: str) -> int:
    """Parse a duration such as `60`, in seconds, or with a unit, `2 min`; return it in nanoseconds.

    Raises:
        OptionError: the text is not a duration above 0.
    """
    seconds = _quantity(text, TIME, 1.0)
    if seconds is None or not 0.0 < seconds <= 1e9 or not nanoseconds(seconds):
        raise OptionError(
            f"--duration: found `{text}`; expected a time above 0 and at most 1e9 s, such as 60 or 2min"
        )
    return nanoseconds(seconds)


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
    yaw = _quantity(text, ANGLE, 1.0)
    return yaw if yaw is not None and abs(yaw) <= 360.0 else None


def variables(robot: Robot, settings: tuple[str, ...]) -> dict[str, Value]:
    """Parse DServer's variables from texts `NAME=VALUE`, in the units of the sensors that read them.

    A value is a number, with or without a unit; true or false; an enumerator; or a list of such values: `[1,
    2]`.

    Raises:
        OptionError: a text is not of this form, no sensor reads the variable, or the value has another type.
    """
    readers = {s.field: s for s in robot.sensors if s.server == "DServer"}
    values: dict[str, Value] = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        name = name.strip().removeprefix("DServer.")
        if not (name and equals):
            raise OptionError(f"--set: found `{setting}`; expected NAME=VALUE")
        sensor = readers.get(name)
        if sensor is None:
            hint = name_hint(name, readers)
            raise OptionError(f"--set: no sensor reads DServer.{name}; {hint}")
        values[name] = _value(sensor, text.strip())
    return values


def _value(sensor: Sensor, text: str) -> Value:
    if isinstance(sensor.type, Array):
        if not (text.startswith("[") and text.endswith("]")):
            raise OptionError(f"--set {sensor.field}: found `{text}`; expected a list of {sensor.type.size}")
        parts = [p.strip() for p in text[1:-1].split(",")]
        if len(parts) != sensor.type.size:
            what = f"{len(parts)} values; expected {sensor.type.size}"
            raise OptionError(f"--set {sensor.field}: found {what}")
        element = sensor.type.element
        return tuple(_scalar(sensor, element, part) for part in parts)
    return _scalar(sensor, sensor.type, text)


def _scalar(sensor: Sensor, type_: Scalar, text: str) -> ScalarValue:
    match type_:
        case Bool():
            if text in ("true", "false"):
                return text == "true"
            expected = "true or false"
        case Enum(name=name, members=members):
            numbers = dict(members)
            number = _quantity(text, Dimension(), 1.0)
            if text.removeprefix(f"{name}.") in numbers:
                return numbers[text.removeprefix(f"{name}.")]
            if number is not None and number in numbers.values():
                return number
            expected = "one of " + ", ".join(f"{name}.{member}" for member in numbers)
        case Quantity(dimension=dimension):
            value = _quantity(text, dimension, sensor.factor)
            if value is not None:
                return value
            expected = f"a number in {dimension}" if dimension != Dimension() else "a number"
    raise OptionError(f"--set {sensor.field}: found `{text}`; expected {expected}")


def _quantity(text: str, dimension: Dimension, factor: float) -> float | None:
    """Parse a number, with or without a unit of this dimension; return it in units of `factor` base units.

    Returns None for any other text.
    """
    parts = _QUANTITY.fullmatch(text.strip())
    if parts is None:
        return None
    number = float(parts[1])
    if not math.isfinite(number):
        return None
    if not parts[2]:
        return number
    try:
        unit = parse_unit(parts[2])
    except UnitError:
        return None
    return number * float(unit.factor) / factor if unit.dimension == dimension else None
