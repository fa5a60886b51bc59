"""`colony map`: the contents of a map, and a picture of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from colony.cli.exit_codes import EXIT_MISUSE
from colony.cli.outputs import MAP, check_output, write_whole
from colony.cli.reporting import report
from colony.extras import expect_extras

if TYPE_CHECKING:
    from colony.nav.maps.stickrep.model import Pose
    from colony.nav.maps.world_map import WorldMap


@click.command("map", short_help="draw a map")
@click.argument("path", metavar="MAP", type=MAP)
@click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="The picture, PNG or SVG. [default: the name of the map with .png, in this folder; with _map.png if "
    "it is a grid]",
)
@click.option("--no-picture", is_flag=True, help="Do not draw a picture.")
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(path: str, output: Path | None, no_picture: bool, format_: str) -> None:
    """Check the map MAP, a StickRep map or an occupancy grid, describe it, and draw it.

    Of a StickRep map, the maps that its elevators lead to are checked as well. All errors are reported, each
    with its location and a hint.

    Exit code: 0 for a valid map, 2 for one that is invalid or cannot be read.

    \b
    Example:
      colony map loop
      colony map office.yaml
      colony map msu_engineering_3 -o third_floor.svg
    """
    expect_extras("sim")
    from colony.text.diagnostics import DiagnosticError

    if output is not None and output.suffix.lower() not in (".png", ".svg"):
        message = f"cannot draw into `{output}`; expected a file ending in .png or .svg"
        raise click.UsageError(message, click.get_current_context())
    try:
        world, start, summary, text = _described(path)
    except DiagnosticError as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    target = None if no_picture else output or Path(f"{world.name}{_ending(world)}.png")
    if target is not None:
        check_output(target, world.files)
        _draw(world, start, target)
    if format_ == "json":
        import json

        click.echo(json.dumps({**summary, "picture": str(target) if target else None}, indent=2))
    else:
        click.echo(text)
        if target is not None:
            click.echo(f"  drawn in {target}")


class _Described(NamedTuple):
    """A map: its world, where a robot starts, and its summary for programs and for people."""

    world: WorldMap
    start: Pose | None
    summary: dict[str, object]
    text: str


def _described(path: str) -> _Described:
    from colony.nav.maps.source import is_grid
    from colony.nav.maps.world_map import load_world, world_of

    if is_grid(path):
        from colony.cli.map.building import grid_summary, grid_text, start_in

        world = load_world(path)
        start = start_in(world)
        summary = grid_summary(world, start)
        return _Described(world, start, summary, grid_text(summary))
    from colony.cli.map.building import building_summary, building_text
    from colony.nav.maps.building import load_building

    building = load_building(path)
    summary = building_summary(building)
    return _Described(world_of(building.maps[0], path), None, summary, building_text(summary))


def _ending(world: WorldMap) -> str:
    """Return what a picture's name ends in, so that it is not that of a grid's image."""
    return "" if len(world.files) == 1 else "_map"


def _draw(world: WorldMap, start: Pose | None, target: Path) -> None:
    from colony.view.map_picture import draw_world, encode_picture, picture_format

    write_whole(target, encode_picture(draw_world(world, start=start), picture_format(target)))
