"""Posters and fire extinguishers: at their rates, where there is room, clear of plates and of each other."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from colony.nav.maps.signs import plates_of
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.walls import walls_of
from colony.sim.cameras.posters import BLACK_KINDS, POSTERS_MM, posters
from colony.sim.cameras.silhouettes import EXTINGUISHER_MM
from colony.sim.hazards.hazards import Hazards, draw
from colony.sim.hazards.scenery import Scenery
from tests.buildings import HALLWAY, LOOP, MSU

RUNS = 60
DRAWN = [draw(Hazards(), MSU, seed) for seed in range(RUNS)]
WALLS = walls_of(MSU)
LENGTHS = np.hypot(*(WALLS.segments[:, 2:] - WALLS.segments[:, :2]).T)


def spans(scenery: Scenery) -> dict[int, list[tuple[float, float]]]:
    """What hangs on each edge, from where to where."""
    found: dict[int, list[tuple[float, float]]] = {}
    for poster in scenery.posters:
        end = poster.start_mm + POSTERS_MM[poster.kind][0]
        found.setdefault(poster.edge, []).append((poster.start_mm, end))
    for one in scenery.extinguishers:
        half = EXTINGUISHER_MM[0] / 2
        found.setdefault(one.edge, []).append((one.along_mm - half, one.along_mm + half))
    return found


def test_black_posters_hang_on_walls_and_doors_at_their_rates() -> None:
    black = [poster for scenery in DRAWN for poster in scenery.posters if poster.kind in BLACK_KINDS]
    doors = [poster for poster in black if WALLS.kinds[poster.edge] is EdgeKind.DOOR]
    shut = sum(kind is EdgeKind.DOOR for kind in WALLS.kinds)
    expected = RUNS * shut * 0.02
    assert abs(len(doors) - expected) < 4.0 * math.sqrt(expected)
    room = LENGTHS[[kind is EdgeKind.WALL for kind in WALLS.kinds]].sum()
    expected = RUNS * room / 80_000.0
    on_walls = len(black) - len(doors)
    assert on_walls <= expected + 4.0 * math.sqrt(expected)
    assert on_walls >= 0.75 * expected  # short walls have no room for some


def test_other_posters_and_extinguishers_at_theirs() -> None:
    room = LENGTHS[[kind is EdgeKind.WALL for kind in WALLS.kinds]].sum()
    others = sum(poster.kind not in BLACK_KINDS for scenery in DRAWN for poster in scenery.posters)
    extinguishers = sum(len(scenery.extinguishers) for scenery in DRAWN)
    for found, spacing in ((others, 15_000.0), (extinguishers, 25_000.0)):
        expected = RUNS * room / spacing
        assert 0.7 * expected < found < expected + 4.0 * math.sqrt(expected), (found, expected)


@pytest.mark.parametrize("floor", [MSU, LOOP, HALLWAY], ids=lambda floor: floor.name)
def test_nothing_hangs_over_a_plate_or_over_the_end_of_a_wall(floor: Map) -> None:
    walls = walls_of(floor)
    lengths = np.hypot(*(walls.segments[:, 2:] - walls.segments[:, :2]).T)
    crowded = Hazards(poster_spacing_mm=1500.0, black_poster_spacing_mm=4000.0, poster_on_door=0.5)
    for seed in range(4):
        for edge, wall_pictures in spans(draw(crowded, floor, seed)).items():
            taken = [(p.start_mm, p.end_mm) for p in plates_of(floor) if p.edge == edge]
            ordered = sorted([*wall_pictures, *taken])
            assert ordered[0][0] >= 0.0
            assert ordered[-1][1] <= lengths[edge]
            assert all(one[1] < other[0] for one, other in pairwise(ordered))
            assert walls.kinds[edge] is not EdgeKind.ELEVATOR
            assert "window" not in walls.attributes[edge]


def test_posters_are_as_large_as_they_are_said_to_be() -> None:
    assert [(one.width_mm, one.height_mm) for one in posters()] == list(POSTERS_MM)
    for kind in BLACK_KINDS:
        assert np.median(posters()[kind].shades) < 0.1
        assert posters()[kind].shades.max() > 0.5
