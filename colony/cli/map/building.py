"""What `colony map` says of a building."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from colony.nav.maps.building import Building
    from colony.nav.maps.stickrep.model import Pose
    from colony.nav.maps.world_map import WorldMap


# --- building ------------------------------------------------------------------------------------------


def building_summary(building: Building) -> dict[str, object]:
    """Return the content of a building, for programs."""
    from colony.nav.maps.stickrep.checks import linked_rings
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
        "docks": [dock._asdict() for dock in first_map.docks],
        "holes": [hole._asdict() for hole in first_map.holes],
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


def building_text(summary: dict[str, Any]) -> str:
    """Return a summary as text for people."""
    size = summary["size_mm"]
    floor = f", floor {summary['floor']}" if summary["floor"] else ""
    lines = [
        f"{summary['map']}{floor}: {size[0] / 1000:.1f} m by {size[1] / 1000:.1f} m; "
        f"doors: {summary['doors']}, elevators: {summary['elevators']}, ceiling lights: {summary['lights']}",
        f"  start at {pose_text(summary['start'])}",
    ]
    lines += [f"  dock at {pose_text(dock)}" for dock in summary["docks"]]
    lines += [
        f"  hole from ({h['x0_mm']:.0f}, {h['y0_mm']:.0f}) to ({h['x1_mm']:.0f}, {h['y1_mm']:.0f}) mm"
        for h in summary["holes"]
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


def pose_text(pose: dict[str, float]) -> str:
    """Return a pose as text for people."""
    at = f"({pose['x_mm'] / 1000:.2f} m, {pose['y_mm'] / 1000:.2f} m)"
    return f"{at}, heading {pose['heading_deg']:g} degrees"


# --- grid ----------------------------------------------------------------------------------------------
#
# What `colony map` says of an occupancy grid.


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
    from colony.nav.maps.grid.model import Grid, GridCell

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
        "area_m2": {state.name.lower(): round(grid.area_m2(state), 3) for state in GridCell},
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
