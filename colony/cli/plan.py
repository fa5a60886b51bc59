"""`colony plan`: the path from one room to another, in the modes of the Navigator."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_MISUSE
from colony.cli.outputs import MAP, check_output, write_whole
from colony.cli.reporting import report, say
from colony.extras import expect_extras

if TYPE_CHECKING:
    from colony.nav.maps.building import Building
    from colony.nav.maps.stickrep.model import Travel
    from colony.nav.plan.plan import FloorPoint, Plan, Segment


@click.command("plan", short_help="plan a path from room to room")
@click.argument("path", metavar="MAP", type=MAP)
@click.argument("origin", metavar="FROM")
@click.argument("goal", metavar="TO")
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="Draw the path on the map of its first floor, as PNG or SVG.",
)
@click.option(
    "--travel",
    type=click.Choice(["either", "wall-on-left"]),
    help="The side on which paths keep the wall, instead of the map's own rule.",
)
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(
    path: str, origin: str, goal: str, output: Path | None, travel: Travel | None, format_: str
) -> None:
    """Plan the shortest path in the StickRep map MAP from one node to another.

    FROM and TO are door jambs (376L), or doors (376), which stand for the nearer of their jambs. A room on
    another floor that elevators lead to is written `2:250` or `msu_engineering_2:250`.

    The modes are: L along ceiling lights, E into a turning space, C out of it, D to the goal, V through an
    elevator.

    Exit code: 0 for a plan, 2 if there is none.

    \b
    Example:
      colony plan msu_engineering_3 350R 376L
      colony plan loop 201 216 -o plan.png
    """
    expect_extras("sim")
    from colony.nav.maps.building import load_building
    from colony.nav.plan.route import NoPlanError, plan
    from colony.text.diagnostics import DiagnosticError

    if output is not None and output.suffix.lower() not in (".png", ".svg"):
        message = f"cannot draw into `{output}`; expected a file ending in .png or .svg"
        raise click.UsageError(message, click.get_current_context())
    try:
        building = load_building(path)
    except DiagnosticError as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    try:
        planned = plan(building, origin, goal, travel=travel)
    except NoPlanError as problem:
        say(f"{path}: error: {problem}")
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    if output is not None:
        check_output(output, [path])
        _draw(building, planned, output)
    if format_ == "json":
        import json

        click.echo(json.dumps({**_summary(planned), "picture": str(output) if output else None}, indent=2))
    else:
        click.echo(_text(planned))
        if output is not None:
            click.echo(f"drawn in {output}")


def _draw(building: Building, planned: Plan, target: Path) -> None:
    from colony.view.map_picture import draw_plan, encode_picture, picture_format

    floor = building.map_named(planned.segments[0].start.floor)
    write_whole(target, encode_picture(draw_plan(floor, planned), picture_format(target)))


def _summary(planned: Plan) -> dict[str, object]:
    return {
        "origin": planned.origin,
        "goal": planned.goal,
        "distance_mm": round(planned.distance_mm, 3),
        "way_mm": round(planned.travel_mm, 3),
        "modes": planned.modes,
        "segments": [_segment(segment) for segment in planned.segments],
    }


def _segment(segment: Segment) -> dict[str, object]:
    return {
        "mode": chr(segment.kind),
        "heading_deg": round(segment.heading_deg, 3),
        "from": _point(segment.start),
        "to": _point(segment.end),
        "length_mm": round(segment.length_mm, 1),
        "width_mm": round(segment.width_mm, 1),
        "lights_mm": [round(light, 1) for light in segment.lights_mm],
        "turn_deg": round(segment.turn_deg, 3),
        "doors_mm": [round(door_mm, 1) for door_mm in segment.doors_mm],
    }


def _point(point: FloorPoint) -> dict[str, object]:
    return {"x_mm": round(point.x_mm, 1), "y_mm": round(point.y_mm, 1), "floor": point.floor}


def _text(planned: Plan) -> str:
    floors = len({point.floor for s in planned.segments for point in (s.start, s.end)}) > 1
    goal = f"{planned.goal} of {planned.segments[-1].end.floor}" if floors else planned.goal
    lines = [
        f"{planned.origin} to {goal}: {planned.distance_mm / 1000:.3f} m, "
        f"{planned.travel_mm / 1000:.1f} m to travel",
        f"modes: {planned.modes}",
        "",
        "mode  heading           from (m)             to (m)   length  lights",
    ]
    for segment in planned.segments:
        ends = [f"({p.x_mm / 1000:.2f}, {p.y_mm / 1000:.2f})" for p in (segment.start, segment.end)]
        lights = f"{len(segment.lights_mm):6}" if segment.lights_mm else "     -"
        row = (
            f"{chr(segment.kind):4}  {segment.heading_deg:5.0f}°  {ends[0]:>18} {ends[1]:>18}  "
            f"{segment.length_mm / 1000:5.1f} m  {lights}"
        )
        lines.append(f"{row}  {segment.end.floor}" if floors else row)
    return "\n".join(lines)
