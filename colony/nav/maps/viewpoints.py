"""Viewpoints: poses in the middle of a corridor, from which a robot looks at a sign."""

from __future__ import annotations

import math

from colony.nav.maps.signs import door_name, plates_of
from colony.nav.maps.stickrep.geometry import Point, direction
from colony.nav.maps.stickrep.model import EdgeKind, Map, Pose
from colony.nav.maps.walls import facing_deg, free_distance, point_on, walls_of
from colony.text.suggestions import did_you_mean

_MAX_DISTANCE_MM = 1900.0  # from a sign in a wide corridor or a hall
_MIN_CLEARANCE_MM = 500.0
_FROM_CORNER_MM = 500.0  # from the node at which a wall begins


class NoViewpointError(ValueError):
    """A map has no such viewpoint; the message says what was found, and what to do."""


def parse_pose(floor: Map, text: str) -> Pose:
    """Parse the pose "X,Y,HEADING", in mm and degrees.

    Raises:
        NoViewpointError: it is not three numbers, or the position is outside the building.
    """
    try:
        x, y, heading = (float(part) for part in text.split(","))
    except ValueError:
        raise NoViewpointError(
            f"`{text}` is not a viewpoint; expected a door, a node or X,Y,HEADING"
        ) from None
    low_x, low_y, high_x, high_y = walls_of(floor).bounds
    if not (low_x <= x <= high_x and low_y <= y <= high_y and math.isfinite(heading)):
        found = f"({x:g}, {y:g}), heading {heading:g}, is outside of `{floor.name}`"
        raise NoViewpointError(
            f"{found}; expected x from {low_x:.0f} to {high_x:.0f}, y from {low_y:.0f} to {high_y:.0f}"
        )
    return Pose(x, y, heading % 360.0)


def viewpoint_of(floor: Map, name: str) -> Pose:
    """Return the pose in the middle of the corridor in front of a door, a node or an elevator.

    A door's plate, or the center of a door without one, is to the left of the robot; an elevator is ahead of
    it.

    Args:
        floor: the map.
        name: name of the door ("376"), of one of its jambs, or of another node that begins an edge.

    Raises:
        NoViewpointError: there is no such node, or no space in front of it.
    """
    for plate in plates_of(floor):
        if name == plate.door:
            return _facing(floor, name, plate.center, plate.heading_deg, to_left=True)
    walls = walls_of(floor)
    names = [node.name for ring in floor.rings for node in ring.nodes]
    for edge, node in enumerate(names):
        is_door = walls.kinds[edge] is not EdgeKind.WALL
        if name == node or (is_door and name == door_name(node)):
            wall = walls.segments[edge].tolist()
            half = math.dist(wall[:2], wall[2:]) / 2
            target = point_on(wall, half if is_door else min(half, _FROM_CORNER_MM))
            to_left = walls.kinds[edge] is not EdgeKind.ELEVATOR
            return _facing(floor, name, target, facing_deg(wall), to_left=to_left)
    all_names = [*dict.fromkeys((*map(door_name, names), *names))]
    hint = did_you_mean(name, all_names, max_names=3) or "see `colony map`"
    raise NoViewpointError(f"`{floor.name}` has no door or node `{name}`; {hint}")


def _facing(floor: Map, name: str, target: Point, wall_heading_deg: float, *, to_left: bool) -> Pose:
    into = direction(wall_heading_deg)
    away = Point(-into.x, -into.y)
    free_mm = free_distance(walls_of(floor).segments, target, away)
    if free_mm < 2 * _MIN_CLEARANCE_MM:
        raise NoViewpointError(
            f"in front of `{name}` of `{floor.name}` only {free_mm:.0f} mm are free; expected a corridor"
        )
    distance = min(free_mm / 2, _MAX_DISTANCE_MM)
    heading = wall_heading_deg - 90.0 if to_left else wall_heading_deg
    return Pose(target.x + distance * away.x, target.y + distance * away.y, heading % 360.0)
