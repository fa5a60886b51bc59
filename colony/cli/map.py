"""`colony map`: what is in a building, and a picture of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_MISUSE
from colony.cli.outputs import check_output, write_whole
from colony.cli.reporting import report

if TYPE_CHECKING:
    from colony.nav.stickrep import Map


@click.command("map", short_help="draw a building")
@click.argument("path", metavar="MAP")
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="Where to; .png or .svg says which. [default: the map's name with .png, here]",
)
@click.option("--no-picture", is_flag=True, help="Draw nothing.")
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(path: str, output: Path | None, no_picture: bool, format_: str) -> None:
    """Check the StickRep map MAP, say what is in it, and draw it.

    Everything that is wrong with a map is reported, each error with its place and a hint. Exit code 0 for a
    sound map, 2 for a bad one, or one that cannot be read.

    \b
    Example:
      colony map maps/loop.stickrep
      colony map maps/hallway.stickrep -o hallway.svg
    """
    from colony.diagnostics import Failure
    from colony.nav.stickrep_reader import load_map

    if output is not None and output.suffix.lower() not in (".png", ".svg"):
        message = f"cannot draw into `{output}`; expected a file ending in .png or .svg"
        raise click.UsageError(message, click.get_current_context())
    try:
        loaded = load_map(path)
    except Failure as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    target = None if no_picture else output or Path(f"{loaded.name}.png")
    if target is not None:
        check_output(target, [path])
        _draw(loaded, target)
    summary = _summary(loaded)
    if format_ == "json":
        import json

        click.echo(json.dumps({**summary, "picture": str(target) if target else None}, indent=2))
    else:
        click.echo(_text(summary))
        if target is not None:
            click.echo(f"  drawn in {target}")


def _draw(loaded: Map, target: Path) -> None:
    from colony.view.map_picture import draw_map, encode_picture, picture_format

    write_whole(target, encode_picture(draw_map(loaded), picture_format(target)))


def _summary(loaded: Map) -> dict[str, object]:
    from colony.nav.stickrep import EdgeKind
    from colony.nav.walls import lights_of, walls_of

    low_x, low_y, high_x, high_y = walls_of(loaded).bounds
    return {
        "map": loaded.name,
        "size_mm": [round(high_x - low_x, 3), round(high_y - low_y, 3)],
        "doors": loaded.count(EdgeKind.DOOR),
        "elevators": loaded.count(EdgeKind.ELEVATOR),
        "lights": len(lights_of(loaded)),
        "start": loaded.start._asdict(),
        "rings": [
            {
                "name": ring.name,
                "nodes": len(ring.nodes),
                "corners": sum(node.corner for node in ring.nodes),
                "path_length_mm": round(ring.path_length_mm, 3),
            }
            for ring in loaded.rings
        ],
    }


def _text(summary: dict[str, object]) -> str:
    size, rings, start = summary["size_mm"], summary["rings"], summary["start"]
    assert isinstance(size, list)
    assert isinstance(rings, list)
    assert isinstance(start, dict)
    lines = [
        f"{summary['map']}: {size[0] / 1000:.1f} m by {size[1] / 1000:.1f} m; "
        f"doors: {summary['doors']}, elevators: {summary['elevators']}, ceiling lights: {summary['lights']}",
        f"  start at ({start['x_mm'] / 1000:.2f} m, {start['y_mm'] / 1000:.2f} m), "
        f"heading {start['heading_deg']:g} degrees",
    ]
    lines += [
        f"  ring {ring['name']}: {ring['nodes']} nodes, {ring['corners']} corners, "
        f"{ring['path_length_mm'] / 1000:.1f} m around"
        for ring in rings
    ]
    return "\n".join(lines)
