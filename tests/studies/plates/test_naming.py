"""What was taken for a plate is called by its name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import EdgeKind
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import walls_of
from colony.sim.cameras.atlas import BLACK_KINDS, OTHER_KINDS
from colony.sim.hazards.scenery import Extinguisher, Poster, bare_scenery
from studies.lists import PUBLISHED_MAP
from studies.plates.judging import Sighting
from studies.plates.naming import sighting_namer

FLOOR = load_map(PUBLISHED_MAP)
WALLS = walls_of(FLOOR)
EMPTY = bare_scenery(np.zeros((0, 4)))


def _middle(edge: int) -> Point:
    x0, y0, x1, y1 = WALLS.segments[edge].tolist()
    return Point((x0 + x1) / 2, (y0 + y1) / 2)


def _first(kind: EdgeKind, remark: str = "") -> int:
    """The first edge of a kind that is some meters long, if it is a wall."""
    return next(
        i
        for i, edge in enumerate(FLOOR.edges())
        if edge.kind is kind and edge.attribute == (remark or edge.attribute) and edge.length_mm > 700.0
    )


def _at(point: Point) -> Sighting:
    return Sighting(0, point, "")


def test_walls_doors_and_elevators() -> None:
    name = sighting_namer(FLOOR, EMPTY, lambda t_ns: ())
    assert name(_at(_middle(_first(EdgeKind.DOOR)))) == "a door"
    assert name(_at(_middle(_first(EdgeKind.ELEVATOR)))) == "an elevator"
    bricks = next(edge.attribute for edge in FLOOR.edges() if "glass brick" in edge.attribute)
    assert name(_at(_middle(_first(EdgeKind.WALL, bricks)))) == bricks
    assert name(_at(Point(-1e6, -1e6))) == "nothing"


def test_what_hangs_on_walls_comes_before_them_and_people_before_all() -> None:
    wall, door = _first(EdgeKind.WALL), _first(EdgeKind.DOOR)
    half = FLOOR_LENGTHS[wall] / 2, FLOOR_LENGTHS[door] / 2
    posters = (
        Poster(edge=wall, start_mm=half[0], center_mm=1350.0, kind=OTHER_KINDS[0]),
        Poster(edge=door, start_mm=half[1], center_mm=1350.0, kind=BLACK_KINDS[0]),
    )
    scenery = replace(EMPTY, posters=posters)
    name = sighting_namer(FLOOR, scenery, lambda t_ns: ())
    assert name(_at(_middle(wall))) == "a poster"
    assert name(_at(_middle(door))) == "a black poster on a door"
    fire = replace(EMPTY, extinguishers=(Extinguisher(edge=wall, along_mm=half[0]),))
    assert sighting_namer(FLOOR, fire, lambda t_ns: ())(_at(_middle(wall))) == "an extinguisher"
    crowded = sighting_namer(FLOOR, scenery, lambda t_ns: [_middle(wall)])
    assert crowded(_at(_middle(wall))) == "a person"


FLOOR_LENGTHS = np.hypot(*(WALLS.segments[:, 2:] - WALLS.segments[:, :2]).T).tolist()
