"""What `colony map` says of an occupancy grid."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from colony.cli.map.building import pose_text

if TYPE_CHECKING:
    from colony.nav.maps.stickrep.model import Pose
    from colony.nav.maps.world_map import WorldMap

RADIUS_MM = 400.0
"""The radius of the robot for which a start is shown: that of an `amr`."""


def start_in(world: WorldMap) -> Pose | None:
    """Return the pose at which such a robot starts; None if there is no room for it."""
    try:
        return world.start(RADIUS_MM)
    except ValueError:
        return None


def grid_summary(world: WorldMap, start: Pose | None) -> dict[str, object]:
    """Return the content of a grid, for programs."""
    from colony.nav.maps.grid.model import Cell, Grid

    grid = world.source
    assert isinstance(grid, Grid)
    rows, columns = grid.cells.shape
    return {
        "map": world.name,
        "image": grid.image,
        "size_mm": [round(side, 3) for side in grid.size_mm],
        "cells": [columns, rows],
        "cell_mm": grid.cell_mm,
        "origin": {"x_mm": grid.x_mm, "y_mm": grid.y_mm, "yaw_deg": grid.yaw_deg},
        "area_m2": {state.name.lower(): round(grid.area_m2(state), 3) for state in Cell},
        "walls": len(world.walls),
        "start": None if start is None else start._asdict(),
        "reachable": None if start is None else round(world.reachable(RADIUS_MM, start), 4),
        "docks": [dock._asdict() for dock in world.docks],
        "remarks": list(grid.remarks if start is None else world.remarks(RADIUS_MM, start)),
    }


def grid_text(summary: dict[str, Any]) -> str:
    """Return a summary as text for people."""
    size, cells, area, start = (summary[key] for key in ("size_mm", "cells", "area_m2", "start"))
    lines = [
        f"{summary['map']}: {size[0] / 1000:.1f} m by {size[1] / 1000:.1f} m; "
        f"{cells[0]} x {cells[1]} cells of {summary['cell_mm']:g} mm",
        f"  free: {area['free']:.1f} m2, occupied: {area['occupied']:.1f} m2, "
        f"unknown: {area['unknown']:.1f} m2; walls: {summary['walls']}",
    ]
    robot = f"a robot with a radius of {RADIUS_MM:.0f} mm"
    if start is None:
        lines.append(f"  no place for {robot}")
    else:
        lines.append(f"  start of {robot} at {pose_text(start)}")
    lines += [f"  dock at {pose_text(dock)}" for dock in summary["docks"]]
    lines += [f"  {remark}" for remark in summary["remarks"]]
    return "\n".join(lines)
