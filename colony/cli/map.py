"""`colony map`: the contents of a building, and a picture of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from colony.cli.exit_codes import EXIT_MISUSE
from colony.cli.outputs import check_output, write_whole
from colony.cli.reporting import report
from colony.cli.shipped_files import MAP
from colony.extras import expect_extras

if TYPE_CHECKING:
    from colony.nav.maps.building import Building
    from colony.nav.maps.stickrep.model import Map


@click.command("map", short_help="draw a building")
@click.argument("path", metavar="MAP", type=MAP)
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="The picture, PNG or SVG. [default: the name of the map with .png, in this folder]",
)
@click.option("--no-picture", is_flag=True, help="Do not draw a picture.")
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(path: str, output: Path | None, no_picture: bool, format_: str) -> None:
    """Check the StickRep map MAP, describe it, and draw it.

    The maps that its elevators lead to are checked as well. All errors are reported, each with its location
    and a hint.

    Exit code: 0 for a valid map, 2 for one that is invalid or cannot be read.

    \b
    Example:
      colony map loop
      colony map msu_engineering_3 -o third_floor.svg
    """
    expect_extras("sim")
    from colony.nav.maps.building import load_building
    from colony.text.diagnostics import DiagnosticError

    if output is not None and output.suffix.lower() not in (".png", ".svg"):
        message = f"cannot draw into `{output}`; expected a file ending in .png or .svg"
        raise click.UsageError(message, click.get_current_context())
    try:
        building = load_building(path)
    except DiagnosticError as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    first_map = building.maps[0]
    target = None if no_picture else output or Path(f"{first_map.name}.png")
    if target is not None:
        check_output(target, [path])
        _draw(first_map, target)
    summary = _summary(building)
    if format_ == "json":
        import json

        click.echo(json.dumps({**summary, "picture": str(target) if target else None}, indent=2))
    else:
        click.echo(_text(summary))
        if target is not None:
            click.echo(f"  drawn in {target}")


def _draw(first_map: Map, target: Path) -> None:
    from colony.view.map_picture import draw_map, encode_picture, picture_format

    write_whole(target, encode_picture(draw_map(first_map), picture_format(target)))


def _summary(building: Building) -> dict[str, object]:
    from colony.nav.maps.stickrep.connections import linked_rings
    from colony.nav.maps.stickrep.model import EdgeKind
    from colony.nav.maps.walls import lights_of, walls_of

    first_map = building.maps[0]
    low_x, low_y, high_x, high_y = walls_of(first_map).bounds
    return {
        "map": first_map.name,
        "floor": first_map.floor or None,
        "size_mm": [round(high_x - low_x, 3), round(high_y - low_y, 3)],
        "doors": first_map.count(EdgeKind.DOOR),
        "elevators": first_map.count(EdgeKind.ELEVATOR),
        "lights": len(lights_of(first_map)),
        "start": first_map.start._asdict(),
        "travel": first_map.travel,
        "rings": [
            {
                "name": ring.name,
                "nodes": len(ring.nodes),
                "corners": sum(node.corner for node in ring.nodes),
                "path_length_mm": round(ring.path_length_mm, 3),
            }
            for ring in first_map.rings
        ],
        "links": len(first_map.links),
        "linked_rings": [list(group) for group in linked_rings(first_map)],
        "rides": [{"from": first._asdict(), "to": second._asdict()} for first, second in building.rides],
        "other_floors": [{"map": other.name, "floor": other.floor} for other in building.maps[1:]],
    }


def _text(summary: dict[str, Any]) -> str:
    size, start = summary["size_mm"], summary["start"]
    floor = f", floor {summary['floor']}" if summary["floor"] else ""
    lines = [
        f"{summary['map']}{floor}: {size[0] / 1000:.1f} m by {size[1] / 1000:.1f} m; "
        f"doors: {summary['doors']}, elevators: {summary['elevators']}, ceiling lights: {summary['lights']}",
        f"  start at ({start['x_mm'] / 1000:.2f} m, {start['y_mm'] / 1000:.2f} m), "
        f"heading {start['heading_deg']:g} degrees",
    ]
    lines += [
        f"  ring {ring['name']}: {ring['nodes']} nodes, {ring['corners']} corners, "
        f"{ring['path_length_mm'] / 1000:.1f} m around"
        for ring in summary["rings"]
    ]
    if len(summary["rings"]) > 1:
        groups = [" and ".join(group) for group in summary["linked_rings"]]
        where = "may lead over all rings" if len(groups) == 1 else f"stays on {', or on '.join(groups)}"
        lines.append(f"  links: {summary['links']}; a path {where}")
    if summary["travel"] == "wall-on-left":
        lines.append("  paths keep the wall on the left")
    floors = {other["map"]: other["floor"] for other in summary["other_floors"]}
    floors[summary["map"]] = summary["floor"]
    lines += [
        f"  elevator {ride['from']['node']} of floor {floors[ride['from']['map']]}"
        f" is {ride['to']['node']} of floor {floors[ride['to']['map']]} ({ride['to']['map']})"
        for ride in summary["rides"]
    ]
    return "\n".join(lines)
