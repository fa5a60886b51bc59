"""Corridors and turning spaces from rings of walls."""

from __future__ import annotations

import math
from functools import cache

import pytest
from hypothesis import given, settings

from colony.nav.maps.corridors import Corridor, corridors_of, crossing, turning_spaces_of
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import Map
from colony.nav.maps.stickrep.reader import load_map, read_map
from colony.text.source import Source
from tests.nav.maps.small_maps import sound_maps
from tests.paths import MAPS

FLOORS = ("narrow", "atrium", "msu_engineering_2", "msu_engineering_3", "loop", "hallway")


@cache
def corridors(name: str) -> tuple[Corridor, ...]:
    return corridors_of(load_map(MAPS / f"{name}.stickrep"))


def drawn(*rings: str, start: str = "1000 1000 0") -> Map:
    """A map in millimeters; each ring is `X Y HEADING: TURN LENGTH, ...`, where a turn is L, R, l, r or -; of
    these l and r are no corners of a corridor."""
    angles = {"L": "-90", "R": "-270", "l": "90", "r": "270", "-": "180"}
    lines = ["stickrep 1", "map drawn", "unit mm", f"start {start}"]
    for i, ring in enumerate(rings):
        place, _, rows = ring.partition(":")
        lines.append(f"ring r{i} {place}")
        for j, row in enumerate(rows.split(",")):
            turn, length = row.split()
            lines.append(f"{angles[turn]} n{i}_{j} W 0 {length} wall")
    return read_map(Source("drawn", "\n".join(lines)))


def spans(found: tuple[Corridor, ...]) -> set[tuple[int, ...]]:
    """Start, end and width of each, in mm."""
    return {(*map(round, (*c.start, *c.end)), round(c.width_mm)) for c in found}


STRAIGHT = "0 0 0: R 2000, R 12000, R 2000, R 12000"
NOOK = "0 0 0: R 2000, R 5000, l 600, r 1000, r 600, l 6000, R 2000, R 12000"
PILLAR = "0 0 0: R 2000, R 5000, r 500, l 400, l 500, r 6600, R 2000, R 12000"


@pytest.mark.parametrize("ring", [STRAIGHT, NOOK, PILLAR])
def test_a_straight_corridor_with_a_nook_or_a_pillar_is_one(ring: str) -> None:
    assert spans(corridors_of(drawn(ring))) == {(12000, 1000, 0, 1000, 2000)}


def test_the_middle_is_between_what_most_of_the_walls_are() -> None:
    """A vestibule of 1 m, as wide as the corridor and 400 mm more."""
    found = corridors_of(drawn("0 0 0: R 2400, R 1000, r 400, l 11000, R 2000, R 12000"))
    assert spans(found) == {(12000, 1000, 0, 1000, 2000)}


def test_walls_with_a_thin_block_between_them_bound_two_corridors() -> None:
    found = corridors_of(
        drawn("0 0 0: R 3600, R 12000, R 3600, R 12000", "2000 1500 270: L 8000, L 600, L 8000, L 600")
    )
    along = {span for span in spans(found) if span[4] == 1500}
    assert along == {(12000, 750, 0, 750, 1500), (12000, 2850, 0, 2850, 1500)}
    assert all(round(corridor.width_mm) in (1500, 2000) for corridor in found)


def test_a_corridor_ends_a_little_within_a_hall() -> None:
    hall = "0 0 0: R 2000, R 9000, L 5000, R 12000, R 12000, R 12000, R 5000, L 9000"
    found = corridors_of(drawn(hall))
    assert spans(found) == {(13500, 1000, 0, 1000, 2000)}


def test_an_elbow_has_a_turning_space() -> None:
    found = corridors_of(drawn("0 0 0: R 8000, R 2000, R 6000, L 7000, R 2000, R 9000"))
    assert spans(found) == {(1000, 0, 1000, 8000, 2000), (9000, 1000, 0, 1000, 2000)}
    (space,) = turning_spaces_of(found)
    assert space.center == pytest.approx(Point(1000.0, 1000.0))


def test_a_crossing_of_different_widths() -> None:
    arms = "R 2200, R 6000, L 7000, R 3000, R 7000, L 5000, R 2200, R 5000, L 8000, R 3000, R 8000, L 6000"
    found = corridors_of(drawn(f"0 0 270: {arms}", start="1100 -500 0"))
    assert spans(found) == {(1100, -14000, 1100, 0, 2200), (9200, -7500, -8000, -7500, 3000)}
    (space,) = turning_spaces_of(found)
    assert space.center == pytest.approx(Point(1100.0, -7500.0))


def test_a_corridor_that_ends_in_another() -> None:
    arms = "R 12000, R 2000, R 5000, L 7000, R 2500, R 7000, L 4500, R 2000"
    found = corridors_of(drawn(f"0 0 0: {arms}", start="1000 1000 0"))
    assert spans(found) == {(1000, 0, 1000, 12000, 2000), (9000, 5750, 0, 5750, 2500)}


@pytest.mark.parametrize("side", [500, 1500, 3000, 6000])
@pytest.mark.parametrize("width", [1800, 3700])
def test_a_jog_is_a_corridor_of_its_own(side: int, width: int) -> None:
    """Two parallel corridors, `side` apart, joined by a short one."""
    west = f"R 10000, L {side}, R 10000, R {width}"
    east = f"R {10000 - width}, L {side}, R {10000 + width}, R {width}"
    found = corridors_of(drawn(f"0 0 0: {west}, {east}", start="500 500 0"))
    middles = {round(c.width_mm) for c in found}
    assert middles == {width}
    along_north = [c for c in found if c.heading_deg == 0.0]
    assert [round(c.start.x) for c in sorted(along_north, key=lambda c: c.start.x)] == [
        -side + width // 2, width // 2,
    ]  # fmt: skip
    jogs = [c for c in found if c.heading_deg == 90.0]
    assert len(jogs) == 1
    assert jogs[0].length_mm == pytest.approx(side + width)
    assert len(turning_spaces_of(found)) == 2


def test_corridors_around_a_block() -> None:
    found = corridors("loop")
    assert [round(c.width_mm) for c in found] == [2540] * 4
    assert len(turning_spaces_of(found)) == 4
    assert {e for c in found for e in c.edges} == {
        (r, e)
        for r, ring in enumerate(load_map(MAPS / "loop.stickrep").rings)
        for e in range(len(ring.edges))
    }


def test_the_third_floor_has_the_corridors_of_the_thesis() -> None:
    """Twelve legs, of which two, one behind the other, are one corridor."""
    found = corridors("msu_engineering_3")
    assert len(found) == 11
    assert sorted(round(c.width_mm) for c in found) == [3050] * 6 + [3660] * 5
    spaces = turning_spaces_of(found)
    assert len(spaces) == 13
    main = max((c for c in found if c.heading_deg == 0.0), key=lambda c: c.length_mm)
    assert main.length_mm == pytest.approx(116_000, abs=60)
    assert main.start.x == pytest.approx(122_170, abs=60)


@pytest.mark.parametrize(
    "name", ["narrow", "atrium", "msu_engineering_2", "msu_engineering_3", "loop", "hallway"]
)
def test_every_door_is_in_a_corridor(name: str) -> None:
    floor = load_map(MAPS / f"{name}.stickrep")
    bounding = {edge for corridor in corridors(name) for edge in corridor.edges}
    doors = {
        (r, e)
        for r, ring in enumerate(floor.rings)
        for e, edge in enumerate(ring.edges)
        if edge.kind.value != "W"
    }
    assert doors <= bounding


def test_along_and_beside_are_those_of_the_middle_line() -> None:
    corridor = Corridor(
        start=Point(1000.0, 2000.0), end=Point(-3000.0, 2000.0), heading_deg=90.0, width_mm=2000.0, edges=()
    )
    assert corridor.along(0.0, 2500.0) == pytest.approx(1000.0)
    assert corridor.offset(0.0, 2500.0) == pytest.approx(-500.0)
    assert corridor.point_at(4000.0) == pytest.approx(corridor.end)


def test_lines_that_end_before_each_other_do_not_cross() -> None:
    def corridor(start: Point, end: Point, heading: float) -> Corridor:
        return Corridor(start=start, end=end, heading_deg=heading, width_mm=2000.0, edges=())

    west = corridor(Point(9000.0, 0.0), Point(0.0, 0.0), 90.0)
    assert crossing(west, corridor(Point(500.0, 900.0), Point(500.0, 9000.0), 0.0)) == pytest.approx(
        (500.0, 0.0)
    )
    assert crossing(west, corridor(Point(500.0, 1100.0), Point(500.0, 9000.0), 0.0)) is None
    assert crossing(west, corridor(Point(0.0, 100.0), Point(9000.0, 100.0), 90.0)) is None


@given(floor=sound_maps())
@settings(max_examples=40, deadline=None)
def test_whatever_the_walls_corridors_are_sound(floor: Map) -> None:
    for corridor in corridors_of(floor):
        assert corridor.length_mm > 0.0
        assert 1000.0 <= corridor.width_mm <= 4500.0
        assert 0.0 <= corridor.heading_deg < 180.0
        assert math.isfinite(corridor.start.x)
