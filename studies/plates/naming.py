"""The names of the real objects that a finder mistook for door plates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.walls import point_on, walls_of
from colony.sim.cameras.atlas import BLACK_KINDS, posters
from colony.sim.hazards.scenery import PERSON_RADIUS_MM, Scenery
from studies.plates.judging import NameSighting, Sighting

_CLOSE_MM = 500.0

People = Callable[[int], Iterable[Iterable[float]]]
"""Function that returns the positions of all people at a time, x and y in mm."""


class _Object(NamedTuple):
    """A flat object, by its two ends."""

    name: str
    start: Point
    end: Point


def sighting_namer(floor: Map, scenery: Scenery, people: People) -> NameSighting:
    """Return a function that names the object within half a meter of a sighting.

    People come first, then objects on walls, then the wall itself.
    """
    wall_objects = tuple(_objects_on_walls(floor, scenery))
    walls = tuple(_walls(floor))

    def name(sighting: Sighting) -> str:
        position = sighting.position
        if any(
            math.dist(position, person) < _CLOSE_MM + PERSON_RADIUS_MM for person in people(sighting.t_ns)
        ):
            return "a person"
        for objects in (wall_objects, walls):
            nearest = min(objects, key=lambda item: _distance(position, item), default=None)
            if nearest is not None and _distance(position, nearest) < _CLOSE_MM:
                return nearest.name
        return "nothing"

    return name


def _objects_on_walls(floor: Map, scenery: Scenery) -> Iterator[_Object]:
    edges = walls_of(floor)
    rows = edges.segments.tolist()
    for poster in scenery.posters:
        black = "a black poster" if poster.kind in BLACK_KINDS else "a poster"
        on_door = " on a door" if edges.kinds[poster.edge] is not EdgeKind.WALL else ""
        end_mm = poster.start_mm + posters()[poster.kind].width_mm
        row = rows[poster.edge]
        yield _Object(f"{black}{on_door}", point_on(row, poster.start_mm), point_on(row, end_mm))
    for extinguisher in scenery.extinguishers:
        position = point_on(rows[extinguisher.edge], extinguisher.along_mm)
        yield _Object("an extinguisher", position, position)


def _walls(floor: Map) -> Iterator[_Object]:
    for edge, row in zip(floor.edges(), walls_of(floor).segments.tolist(), strict=True):
        match edge.kind:
            case EdgeKind.DOOR:
                name = "a door"
            case EdgeKind.ELEVATOR:
                name = "an elevator"
            case EdgeKind.WALL:
                name = edge.attribute or "a wall"
        yield _Object(name, Point(row[0], row[1]), Point(row[2], row[3]))


def _distance(position: Point, item: _Object) -> float:
    """Return the distance of a position from the nearest point of an object."""
    (x, y), (x0, y0), (x1, y1) = position, item.start, item.end
    square = (x1 - x0) ** 2 + (y1 - y0) ** 2
    along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / square if square > 0.0 else 0.0
    fraction = min(max(along, 0.0), 1.0)
    return math.hypot(x - x0 - fraction * (x1 - x0), y - y0 - fraction * (y1 - y0))
