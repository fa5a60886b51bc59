"""`colony robot show`: what a description and a body say of a robot, as a table and as a picture."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.frame_picture import check_picture
from colony.cli.outputs import write_whole
from colony.cli.reporting import report
from colony.cli.robot.check import describe

if TYPE_CHECKING:
    from colony.body.model import Body, Chassis
    from colony.ir.bearings import Bearings
    from colony.ir.program import Actuator, Robot, Sensor

_MOST_BEARINGS = 8
_COLUMNS = ("name", "type", "server", "device", "within", "rate")


@click.command("show", short_help="list and draw what a robot has")
@click.argument("name", metavar="NAME")
@click.option(
    "--picture",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="Draw the robot into this file, PNG or SVG: its footprint, and the fields of view of its sensors.",
)
def show_command(name: str, picture: Path | None) -> None:
    """List the drive and the limits of a robot, its sensors, actuators and cameras, and draw it.

    NAME is the name of a robot that comes with colony or is in the folder robots, or the path of an
    interface; the body is beside it. Both are checked first, as by `colony robot check`.

    Exit code: 0, 1 if the two have errors, 2 if a file cannot be read or written.

    \b
    Example:
      colony robot show rome
      colony robot show rome --picture rome.svg
    """
    if picture is not None:
        check_picture(picture, [])
    from colony.text.diagnostics import has_errors

    described = describe(name)
    if has_errors(described.diagnostics):
        report(described.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE if described.is_unreadable else EXIT_ERRORS)
    program, body = described.checked.program, described.body.body
    assert program is not None
    assert body is not None
    for line in _lines(program.robot, body):
        click.echo(line)
    if picture is not None:
        _draw(picture, program.robot, body)
        click.echo(f"drawn in {picture}")


def _draw(picture: Path, robot: Robot, body: Body) -> None:
    from colony.view.map_picture import encode_picture, picture_format
    from colony.view.robot_picture import draw_robot
    from colony.view.robot_scene import robot_scene

    figure = draw_robot(robot_scene(robot, body))
    write_whole(picture, encode_picture(figure, picture_format(picture)))


def _lines(robot: Robot, body: Body) -> Iterator[str]:
    """Yield the lines of the text: the body, then a table of sensors, actuators and cameras."""
    from colony.text.wording import duration_text

    chassis = body.chassis
    limits = chassis.limits
    yield f"{robot.name}: {_shape(body)}, {_number(chassis.height_mm)} mm high"
    yield f"  {_drive(chassis)}; frames of {duration_text(robot.frame_ns)}"
    yield (
        f"  at most {_number(limits.velocity_mm_s)} mm/s and {_number(limits.turn_deg_s)} deg/s, "
        f"{_number(limits.acceleration_mm_s2)} mm/s^2 and {_number(limits.turn_acceleration_deg_s2)} deg/s^2"
    )
    if chassis.sideways_mm_s:
        acceleration = _number(chassis.sideways_acceleration_mm_s2)
        yield f"  sideways at most {_number(chassis.sideways_mm_s)} mm/s, {acceleration} mm/s^2"
    yield ""
    rows = [_COLUMNS, *_rows(robot, body)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(_COLUMNS))]
    for row in rows:
        yield f"  {'  '.join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))}".rstrip()


def _drive(chassis: Chassis) -> str:
    from colony.body.model import Differential, Omnidirectional

    match chassis.drive:
        case Differential(wheel_base_mm=None):
            return "differential drive"
        case Differential(wheel_base_mm=float(wheel_base)):
            return f"differential drive, wheels {_number(wheel_base)} mm apart"
        case Omnidirectional(wheel_base_mm=float(wheel_base), wheel_distance_mm=float(axles)):
            apart = f"wheels {_number(wheel_base)} mm apart, axles {_number(axles)} mm"
            return f"omnidirectional drive, {apart}"
        case drive:
            from colony.text.wording import counted

            wheels = f", {counted(len(drive.rolling), 'omni wheel')}" if drive.rolling else ""
            return f"omnidirectional drive{wheels}"


def _shape(body: Body) -> str:
    from colony.body.model import Circle

    match body.chassis.footprint:
        case Circle(radius_mm=radius):
            return f"round, {_number(2 * radius)} mm across"
        case polygon:
            xs, ys = zip(*polygon.corners, strict=True)
            length, width = max(xs) - min(xs), max(ys) - min(ys)
            return f"{len(xs)} corners, {_number(length)} mm long, {_number(width)} mm wide"


def _rows(robot: Robot, body: Body) -> Iterator[tuple[str, ...]]:
    yield from (_row(sensor, body) for sensor in robot.sensors)
    yield from (_row(actuator, body) for actuator in robot.actuators)
    for name, server in body.servers.items():
        if server.simulated is not None and not (server.simulated.fields or server.simulated.commands):
            yield name, "images", name, _device(body, name), "", ""


def _row(declared: Sensor | Actuator, body: Body) -> tuple[str, ...]:
    from colony.ir.program import Actuator
    from colony.text.wording import duration_text

    server = body.servers.get(declared.server)
    of = declared.command if isinstance(declared, Actuator) else declared.field
    device = _device(body, declared.server, of)
    if isinstance(declared, Actuator):
        fields = ", ".join(field.name for field in declared.fields)
        return declared.name, f"{{ {fields} }}", f"{declared.server}.{declared.command}", device, "", ""
    within = "" if declared.within_ns is None else duration_text(declared.within_ns)
    rate = None if server is None else server.rate_of(declared.field)
    return (
        declared.name,
        _type(declared),
        f"{declared.server}.{declared.field}",
        device,
        within,
        "" if rate is None else f"{_number(rate)} Hz",
    )


def _type(sensor: Sensor) -> str:
    """Return a sensor's type in its declared unit, with the bearings of its first and last element."""
    from colony.ir.types import Array, bearings_of, element_type, type_text

    text = sensor.unit or type_text(element_type(sensor.type))
    if not isinstance(sensor.type, Array):
        return text
    bearings = bearings_of(sensor.type)
    text += f"[{sensor.type.size}]"
    if bearings is None:
        return text
    return f"{text} {_bearings_text(bearings)} deg"


def _bearings_text(bearings: Bearings) -> str:
    """Return the first and last of bearings with a step, and of others all, or the first few and the last."""
    first, *others = bearings.angles
    if bearings.step is not None:
        return f"{_number(first)} .. {_number(first + bearings.step * len(others))}"
    shown = [_number(180.0 if angle == -180.0 else angle) for angle in bearings.angles]
    return ", ".join(
        shown if len(shown) <= _MOST_BEARINGS else [*shown[: _MOST_BEARINGS - 2], "...", shown[-1]]
    )


def _device(body: Body, name: str, of: str = "") -> str:
    """Return the devices of a server, and the topic of a field or of a command."""
    from colony.body.devices import DEVICES
    from colony.body.ros2 import ODOM, field_topic

    server = body.servers.get(name)
    if server is None:
        return ""
    simulated = [word for word, type_ in DEVICES if isinstance(server.simulated, type_)]
    real = [server.hardware.driver] if server.hardware else []
    topic = field_topic(server.ros2, of) or server.ros2.get(ODOM)
    topics = [] if topic is None else [topic.name]
    return ", ".join([*simulated, *real, *topics])


def _number(value: float) -> str:
    return f"{value:.10g}"
