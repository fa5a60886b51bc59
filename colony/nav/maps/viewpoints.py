"""Viewpoints: poses from which a robot looks at a sign, in the middle of the corridor."""

from __future__ import annotations

import math

from colony.nav.maps.signs import door_name, plates_of
from colony.nav.maps.stickrep.geometry import Point, direction
from colony.nav.maps.stickrep.model import EdgeKind, Map, Pose
from colony.nav.maps.walls import facing_deg, free_distance, point_on, walls_of
from colony.text.suggestions import did_you_mean

_FARTHEST_MM = 1900.0  # from a sign in a wide corridor or a hall
_MIN_ROOM_MM = 500.0
_FROM_CORNER_MM = 500.0  # of a wall that begins at a node


class NoPlaceError(ValueError):
    """A map does not have a place; the message says what was found, and what to do."""


def parse_pose(floor: Map, place: str) -> Pose:
    """Parse the pose "X,Y,HEADING", in mm and degrees.

    Raises:
        NoPlaceError: it is not three numbers, or outside of the building.
    """
    try:
        x, y, heading = (float(part) for part in place.split(","))
    except ValueError:
        raise NoPlaceError(f"`{place}` is not a place; expected a door, a node or X,Y,HEADING") from None
    low_x, low_y, high_x, high_y = walls_of(floor).bounds
    if not (low_x <= x <= high_x and low_y <= y <= high_y and math.isfinite(heading)):
        found = f"({x:g}, {y:g}), heading {heading:g}, is outside of `{floor.name}`"
        raise NoPlaceError(
            f"{found}; expected x from {low_x:.0f} to {high_x:.0f}, y from {low_y:.0f} to {high_y:.0f}"
        )
    return Pose(x, y, heading % 360.0)


def pose_before(floor: Map, name: str) -> Pose:
    """Return the pose in the middle of the corridor before a door, a node or an elevator.

    A door's plate is to the robot's left, or the middle of a door without a plate. An elevator is ahead of
    the robot.

    Args:
        floor: the map.
        name: name of the door ("376"), of one of its jambs, or of another node that begins an edge.

    Raises:
        NoPlaceError: there is no such node, or no room before it.
    """
    for plate in plates_of(floor):
        if name == plate.door:
            return _before(floor, name, plate.middle, plate.heading_deg, to_left=True)
    walls = walls_of(floor)
    names = [node.name for ring in floor.rings for node in ring.nodes]
    for edge, node in enumerate(names):
        is_door = walls.kinds[edge] is not EdgeKind.WALL
        if name == node or (is_door and name == door_name(node)):
            wall = walls.segments[edge].tolist()
            half = math.dist(wall[:2], wall[2:]) / 2
            middle = point_on(wall, half if is_door else min(half, _FROM_CORNER_MM))
            to_left = walls.kinds[edge] is not EdgeKind.ELEVATOR
            return _before(floor, name, middle, facing_deg(wall), to_left=to_left)
    known = [*dict.fromkeys((*map(door_name, names), *names))]
    hint = did_you_mean(name, known, most=3) or "see `colony map`"
    raise NoPlaceError(f"`{floor.name}` has no door or node `{name}`; {hint}")


def _before(floor: Map, name: str, middle: Point, into_deg: float, *, to_left: bool) -> Pose:
    into = direction(into_deg)
    away = Point(-into.x, -into.y)
    free = free_distance(walls_of(floor).segments, middle, away)
    if free < 2 * _MIN_ROOM_MM:
        raise NoPlaceError(f"before `{name}` of `{floor.name}` there are {free:.0f} mm; expected a corridor")
    back = min(free / 2, _FARTHEST_MM)
    heading = into_deg - 90.0 if to_left else into_deg
    return Pose(middle.x + back * away.x, middle.y + back * away.y, heading % 360.0)
