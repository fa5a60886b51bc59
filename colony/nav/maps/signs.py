"""The signs on the walls of a map: door plates and the markers on elevator doors (sections 5.4.6 and 5.7).

The signs follow from the doors and elevators of the map. The plate of a door hangs beside it, on the side of
its right jamb as seen from the corridor, or on the other side if there is no wall. A marker is
centered on an elevator's doors. All signs hang at the height of the robot's cameras.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from colony.nav.maps.stickrep.geometry import Point, direction
from colony.nav.maps.stickrep.model import EdgeKind, Map, Pose
from colony.nav.maps.walls import facing_deg, free_distance, point_on, walls_of
from colony.text.wording import did_you_mean

SIGN_HEIGHT_MM = 1350.0
"""Height of the center of plates and markers above the floor (53 inches)."""

PLATE_WIDTH_MM, PLATE_HEIGHT_MM = 356.0, 127.0
CHARACTER_HEIGHT_MM = 89.0
"""Height of the characters on a plate; they are white on black."""

STRIPE_MM, STRIPE_HEIGHT_MM = 88.9, 152.4
"""The width and height of each separator and bit of a marker: 3.5 by 6 inches."""

MARKER_BITS = 3
MARKER_WIDTH_MM = (2 * MARKER_BITS + 1) * STRIPE_MM
MARKER_CODES = (0b000, 0b100, 0b010, 0b001, 0b101)
"""All codes of three bits without two consecutive ones; the elevators of a map get them in turn."""

CHARACTERS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ"
"""The characters that may appear on a plate."""

_GAP_MM = 70.0
_MAX_CHARACTERS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Sign:
    """A sign on a wall.

    Attributes:
        edge: index of the map's edge on which it hangs, in the order of `Map.edges`.
        start_mm, end_mm: its extent along that edge, from the edge's first node.
        center: position of its center in the plane, in mm.
        heading_deg: heading of a robot that faces it: into the wall, perpendicular to it.
    """

    edge: int
    start_mm: float
    end_mm: float
    center: Point
    heading_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Plate(Sign):
    """The plate of a door: the door's name in the map ("364.double"), and the text on it ("364")."""

    door: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Marker(Sign):
    """The marker of an elevator whose edge begins at `node`.

    `code` is its three bits, the leftmost one first as seen from the corridor.
    """

    node: str
    code: int


def plate_text(door: str) -> str:
    """Return the text on the plate of a door: the part of its name with a digit, or else the last part.

    "340.cmptr.room" -> 340, "A342" -> A342, "NE.men" -> MEN. The text has at most five of the `CHARACTERS`.
    """
    parts = door.split(".")
    part = next((p for p in parts if any(c.isdigit() for c in p)), parts[-1])
    return "".join(c for c in part.upper() if c in CHARACTERS)[:_MAX_CHARACTERS]


def plates_of(floor: Map) -> tuple[Plate, ...]:
    """Return the plates of all doors, in the order of the map.

    A door has no plate if no wall beside it is wide enough, if a neighbor's plate is in the way, or if its
    name has no characters to write.
    """
    walls = walls_of(floor)
    segments = walls.segments.tolist()
    lengths = _lengths(segments)
    doors = [
        (first + i, first + (i + 1) % len(ring), first + (i - 1) % len(ring), door_name(name))
        for ring, first in _rings(floor)
        for i, name in enumerate(ring)
        if walls.kinds[first + i] is EdgeKind.DOOR
    ]
    plates: dict[int, Plate] = {}
    for at_right in (True, False):
        for door, after, before, name in doors:
            edge, text = after if at_right else before, plate_text(name)
            length = lengths[edge]
            start = _GAP_MM if at_right else length - _GAP_MM - PLATE_WIDTH_MM
            free = walls.kinds[edge] is EdgeKind.WALL and length >= PLATE_WIDTH_MM + _GAP_MM
            free = free and not any(_is_too_close(other, edge, start) for other in plates.values())
            if text and free and door not in plates and _is_straight(segments[edge], segments[door]):
                plates[door] = _plate(segments[edge], edge, start, name, text)
    return tuple(plates[door] for door, *_ in doors if door in plates)


def markers_of(floor: Map) -> tuple[Marker, ...]:
    """Return the markers on the doors of all elevators, in the order of the map.

    Doors narrower than a marker have none.
    """
    walls = walls_of(floor)
    names = [node.name for ring in floor.rings for node in ring.nodes]
    markers: list[Marker] = []
    for edge, (kind, segment) in enumerate(zip(walls.kinds, walls.segments.tolist(), strict=True)):
        length = math.hypot(segment[2] - segment[0], segment[3] - segment[1])
        if kind is EdgeKind.ELEVATOR and length >= MARKER_WIDTH_MM:
            start = (length - MARKER_WIDTH_MM) / 2
            code = MARKER_CODES[len(markers) % len(MARKER_CODES)]
            end = start + MARKER_WIDTH_MM
            markers.append(
                Marker(
                    edge=edge, start_mm=start, end_mm=end, center=point_on(segment, length / 2),
                    heading_deg=facing_deg(segment), node=names[edge], code=code,
                )
            )  # fmt: skip
    return tuple(markers)


def door_name(node: str) -> str:
    """Return the name of a door without the letter of its jamb: "352L" -> 352, "NE.men.L" -> NE.men."""
    return node[:-1].rstrip(".") if len(node) > 1 and node[-1] in "LR" else node


def _rings(floor: Map) -> list[tuple[list[str], int]]:
    """Return the names of each ring's nodes, and the index of its first edge."""
    rings, first = [], 0
    for ring in floor.rings:
        rings.append(([node.name for node in ring.nodes], first))
        first += len(ring.nodes)
    return rings


def _plate(segment: list[float], edge: int, start: float, door: str, text: str) -> Plate:
    end = start + PLATE_WIDTH_MM
    center = point_on(segment, (start + end) / 2)
    return Plate(
        edge=edge,
        start_mm=start,
        end_mm=end,
        center=center,
        heading_deg=facing_deg(segment),
        door=door,
        text=text,
    )


def _is_too_close(plate: Plate, edge: int, start: float) -> bool:
    """Return True if a plate overlaps one that would begin at `start`, or leaves less than the usual gap."""
    return plate.edge == edge and abs(plate.start_mm - start) < PLATE_WIDTH_MM + _GAP_MM


def _lengths(segments: list[list[float]]) -> list[float]:
    return [math.hypot(x1 - x0, y1 - y0) for x0, y0, x1, y1 in segments]


def _is_straight(first: list[float], second: list[float]) -> bool:
    """Return True if two segments have the same direction: the wall continues straight beside the door."""
    (ax, ay, bx, by), (cx, cy, dx, dy) = first, second
    ux, uy, vx, vy = bx - ax, by - ay, dx - cx, dy - cy
    return abs(ux * vy - uy * vx) < 0.02 * math.hypot(ux, uy) * math.hypot(vx, vy) and ux * vx + uy * vy > 0.0


# --- viewpoints ---------------------------------------------------------------------------------------
#
# Viewpoints: poses in the middle of a corridor, from which a robot looks at a sign.

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
