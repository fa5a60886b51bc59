"""`colony sim snapshot`: the views of a robot's cameras at a position."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, assert_never

import click

from colony.cli.exit_codes import EXIT_MISUSE
from colony.cli.outputs import MAP, cannot_write, check_output, write_whole
from colony.cli.reporting import report, say
from colony.extras import expect_extras

if TYPE_CHECKING:
    from colony.nav.maps.stickrep.model import Map
    from colony.vision.signs_in_view import SignInView

_MAX_SPEED_MM_S = 5000.0
_MIN_SIGN_WIDTH_PX = 8.0  # narrower signs are not listed
_Pose = tuple[float, float, float]


def _size(context: click.Context, option: click.Parameter, value: str) -> tuple[int, int]:
    """Parse WIDTHxHEIGHT in pixels."""
    sides = [int(side) for side in value.split("x") if side.isdecimal() and len(side) < 6]
    if len(sides) != 2 or not all(16 <= side <= 2000 for side in sides):
        raise click.BadParameter(f"`{value}`; expected WIDTHxHEIGHT in pixels, from 16x16 to 2000x2000")
    return sides[0], sides[1]


def _facing(context: click.Context, option: click.Parameter, value: str) -> float | None:
    """Parse degrees; return None for `plate`."""
    if value == "plate":
        return None
    try:
        degrees = float(value)
    except ValueError:
        degrees = math.nan
    if not -360.0 <= degrees <= 360.0:
        raise click.BadParameter(f"`{value}`; expected `plate`, or degrees counterclockwise from north")
    return degrees


def _speed(context: click.Context, option: click.Parameter, value: float) -> float:
    """Check a speed in mm/s, positive ahead and negative backward."""
    if not abs(value) <= _MAX_SPEED_MM_S:
        expected = f"from -{_MAX_SPEED_MM_S:.0f} to {_MAX_SPEED_MM_S:.0f} mm/s"
        raise click.BadParameter(f"`{value:g}`; expected a speed {expected}")
    return value


@click.command("snapshot", short_help="save the views of a robot's cameras")
@click.argument("path", metavar="MAP", type=MAP)
@click.option(
    "--at",
    "where",
    required=True,
    metavar="PLACE",
    help="The robot's position: in the corridor before a room (376), a jamb (376L) or an elevator; "
    "or X,Y,HEADING, in mm and degrees.",
)
@click.option(
    "--facing",
    callback=_facing,
    default="plate",
    show_default=True,
    metavar="DEG|plate",
    help="The robot's heading before a room, counterclockwise from north; with `plate` its left camera "
    "looks at the plate, or its front camera at the marker.",
)
@click.option(
    "--hazards", type=click.IntRange(min=0), metavar="SEED", help="Simulate hazards drawn from this seed."
)
@click.option(
    "--speed",
    type=float,
    callback=_speed,
    default=0.0,
    show_default=True,
    metavar="MM/S",
    help="The robot's speed ahead, which blurs near objects.",
)
@click.option(
    "--size",
    callback=_size,
    default="240x120",
    show_default=True,
    metavar="WxH",
    help="The size of the pictures in pixels.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path(),
    metavar="FOLDER",
    help="The folder of the pictures, created if necessary; existing pictures are replaced. "
    "[default: the current folder]",
)
def snapshot_command(
    path: str,
    where: str,
    facing: float | None,
    hazards: int | None,
    speed: float,
    size: tuple[int, int],
    output: Path,
) -> None:
    """Place a robot in the building of MAP, save the views of its cameras as side.png (to the left),
    front.png and up.png (the ceiling), and list the plates and markers in view.

    With --hazards some doors are open, people stand where their walks begin, posters hang on the walls, and
    some lights are out.

    \b
    Example:
      colony sim snapshot msu_engineering_3 --at 376
      colony sim snapshot msu_engineering_3 --at 354 --hazards 7 --size 640x480 -o shots
    """
    expect_extras("sim")
    from colony.nav.maps.signs import NoViewpointError
    from colony.nav.maps.stickrep.reader import load_map
    from colony.text.diagnostics import DiagnosticError

    try:
        floor = load_map(path)
        pose = _pose(floor, where, facing)
    except DiagnosticError as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    except NoViewpointError as problem:
        say(f"{path}: error: {problem}")
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    names = (*_yaws(), "up")
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        cannot_write(output, problem.strerror or str(problem))
    for name in names:
        check_output(output / f"{name}.png", [path])
    from colony.sim.compiling import announcing_compilation

    with announcing_compilation(say):
        from colony.sim.cameras.snapshot import png_of, snapshots

    images = snapshots(floor, pose, _yaws(), size, hazards=hazards, speed_mm_s=speed)
    for name in names:
        write_whole(output / f"{name}.png", png_of(images[name]))
    click.echo(f"at ({pose[0]:.0f} mm, {pose[1]:.0f} mm), heading {pose[2]:.0f} degrees")
    for name in names:
        click.echo(f"  {output / name}.png: {_view_text(floor, pose, name, size)}")


def _pose(floor: Map, where: str, facing: float | None) -> _Pose:
    """Return the robot's pose.

    Raises:
        NoViewpointError: the map has no such position, it is not in a corridor, or there are two headings.
    """
    from colony.nav.maps.signs import NoViewpointError, parse_pose, viewpoint_of

    if "," in where:
        if facing is not None:
            raise NoViewpointError(f"`{where}` has a heading already; leave out --facing")
        return parse_pose(floor, where)
    x, y, heading = viewpoint_of(floor, where)
    return x, y, heading if facing is None else facing % 360.0


def _yaws() -> dict[str, float]:
    """Return the direction of each level camera, counterclockwise from ahead."""
    from colony.vision.level_camera import AHEAD, SIDE

    return {"side": SIDE.yaw_deg, "front": AHEAD.yaw_deg}


def _view_text(floor: Map, pose: _Pose, name: str, size: tuple[int, int]) -> str:
    """Return a description of the signs in a camera's view, nearest first."""
    from colony.vision.level_camera import AHEAD
    from colony.vision.signs_in_view import signs_in_view

    yaws = _yaws()
    if name not in yaws:
        return "the ceiling"
    camera = replace(AHEAD, columns=size[0], rows=size[1], yaw_deg=yaws[name])
    signs = [sign for sign in signs_in_view(floor, pose, camera) if _width(sign) >= _MIN_SIGN_WIDTH_PX]
    return "; ".join(map(_sign, signs)) or "neither plate nor marker"


def _width(sign: SignInView) -> float:
    return sign.corners[1][0] - sign.corners[0][0]


def _sign(sign: SignInView) -> str:
    from colony.nav.maps.signs import MARKER_BITS, Marker, Plate

    match sign.sign:
        case Plate(text=text):
            label = f"plate {text}"
        case Marker(code=code, node=node):
            label = f"marker {code:0{MARKER_BITS}b} of {node}"
        case _:
            assert_never(sign.sign)
    (left, _), (right, _), *_ = sign.corners
    return f"{label}, columns {left:.0f} to {right:.0f}, {sign.distance_mm / 1000:.2f} m away"
