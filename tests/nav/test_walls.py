from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from colony.nav.stickrep import EdgeKind
from colony.nav.stickrep_reader import load_map, read_map
from colony.nav.walls import lights_of, walls_of
from colony.source import Source
from tests.nav.maps_for_tests import ROOM

MAPS = Path(__file__).resolve().parents[2] / "maps"
INCH = 25.4


def test_walls_of_a_room() -> None:
    walls = walls_of(read_map(Source("room", ROOM)))
    expected = [(0, 0, 0, 100), (0, 100, 120, 100), (120, 100, 120, 0), (120, 0, 0, 0)]
    assert walls.segments / INCH == pytest.approx(np.array(expected), abs=1e-9)
    assert walls.kinds == (EdgeKind.WALL, EdgeKind.WALL, EdgeKind.DOOR, EdgeKind.WALL)
    assert walls.bounds == pytest.approx((0.0, 0.0, 120 * INCH, 100 * INCH))
    assert not walls.segments.flags.writeable


def test_a_light_on_one_edge_hangs_half_way_across() -> None:
    assert lights_of(read_map(Source("room", ROOM))) / INCH == pytest.approx(np.array([[60.0, 50.0]]))


def test_a_map_without_lights() -> None:
    text = ROOM.replace("1 60 120", "0 120")
    assert lights_of(read_map(Source("room", text))).shape == (0, 2)


@pytest.mark.parametrize("name", ["hallway", "loop"])
def test_rings_are_closed_without_leaks(name: str) -> None:
    source = load_map(MAPS / f"{name}.stickrep")
    segments = walls_of(source).segments
    at = 0
    for ring in source.rings:
        part = segments[at : at + len(ring.edges)]
        assert (part[:, 2:] == np.roll(part[:, :2], -1, axis=0)).all()
        at += len(ring.edges)
    assert at == len(segments)


def test_the_lights_of_the_loop_hang_in_the_middle_of_its_corridor() -> None:
    lights = lights_of(load_map(MAPS / "loop.stickrep")) / INCH
    assert len(lights) == 20
    from_the_outline = np.minimum.reduce(
        [lights[:, 0], 1200 - lights[:, 0] - 20, lights[:, 1], 788 - lights[:, 1]]
    )
    assert from_the_outline == pytest.approx(np.full(20, 50.0))
