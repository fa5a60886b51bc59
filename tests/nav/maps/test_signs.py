"""The places of plates and markers: every door of the maps has its plate, in view of a passing robot."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest

from colony.nav.maps.signs import (
    CHARACTERS,
    MARKER_CODES,
    PLATE_WIDTH_MM,
    Sign,
    door_name,
    markers_of,
    plate_text,
    plates_of,
)
from colony.nav.maps.stickrep.geometry import Point, direction
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.stickrep.reader import load_map
from colony.nav.maps.walls import free_distance, walls_of
from tests.paths import MAPS

FLOORS = sorted(MAPS.glob("*.stickrep"))

NOOK = """stickrep 1
map   nook
unit  m
start 1 1 0
ring outline 0 0 0
-270 A    W 0 4
 180 12L  D 0 0.9
{after}
-270 B    W 0 {rest}
-270 C    W 0 {length}
-270 D    W 0 {rest}
"""


def nook(folder: Path, after_m: float) -> Map:
    """A door with so much wall behind its right jamb, and 4 m before its left one."""
    path = folder / "nook.stickrep"
    length = 4.9 + after_m
    path.write_text(NOOK.format(after=f" 180 12R W 0 {after_m}", rest=2, length=length))
    return load_map(path)


def on_its_wall(floor: Map, sign: Sign) -> bool:
    x0, y0, x1, y1 = walls_of(floor).segments[sign.edge].tolist()
    length = math.hypot(x1 - x0, y1 - y0)
    along = ((sign.center.x - x0) * (x1 - x0) + (sign.center.y - y0) * (y1 - y0)) / length
    across = ((sign.center.y - y0) * (x1 - x0) - (sign.center.x - x0) * (y1 - y0)) / length
    inside = 0.0 <= sign.start_mm < sign.end_mm <= length
    return inside and abs(across) < 1e-3 and abs(along - (sign.start_mm + sign.end_mm) / 2) < 1e-3


@pytest.mark.parametrize("path", FLOORS, ids=lambda path: path.stem)
def test_every_door_of_the_maps_has_a_plate_that_faces_free_space(path: Path) -> None:
    floor = load_map(path)
    plates = plates_of(floor)
    assert len(plates) == floor.count(EdgeKind.DOOR)
    walls = walls_of(floor)
    for sign in (*plates, *markers_of(floor)):
        assert on_its_wall(floor, sign)
        away = direction(sign.heading_deg + 180.0)
        before = Point(sign.center.x + 10.0 * away.x, sign.center.y + 10.0 * away.y)
        assert free_distance(walls.segments, before, away) > 1000.0
        into = direction(sign.heading_deg)
        assert free_distance(walls.segments, before, into) == pytest.approx(10.0, abs=0.1)


@pytest.mark.parametrize("path", FLOORS, ids=lambda path: path.stem)
def test_plates_hang_on_walls_and_markers_on_elevators(path: Path) -> None:
    floor = load_map(path)
    kinds = walls_of(floor).kinds
    assert {kinds[plate.edge] for plate in plates_of(floor)} <= {EdgeKind.WALL}
    assert {kinds[marker.edge] for marker in markers_of(floor)} <= {EdgeKind.ELEVATOR}
    assert all(plate.text and set(plate.text) <= set(CHARACTERS) for plate in plates_of(floor))


def test_a_plate_is_at_the_right_jamb_as_seen_by_who_stands_before_it(tmp_path: Path) -> None:
    # The wall runs north with the corridor to its east: a robot that faces it looks west, and right is north.
    (plate,) = plates_of(nook(tmp_path, 1.0))
    assert plate.heading_deg == pytest.approx(90.0)
    assert plate.center.y > 4900.0
    assert plate.start_mm == 70.0


@pytest.mark.parametrize(("between_m", "doors"), [(0.5, ["12"]), (0.92, ["12"]), (0.93, ["12", "13"])])
def test_two_plates_never_hang_on_each_other(between_m: float, doors: list[str], tmp_path: Path) -> None:
    # Door 13 has no wall at its right jamb, and between it and door 12 is room for one plate, or for two.
    after = f" 180 12R W 0 {between_m}\n 180 13L D 0 0.9"
    path = tmp_path / "nook.stickrep"
    path.write_text(NOOK.format(after=after, rest=2, length=5.8 + between_m))
    plates = plates_of(load_map(path))
    assert [plate.door for plate in plates] == doors
    starts = sorted(plate.start_mm for plate in plates)
    assert all(right - left >= PLATE_WIDTH_MM for left, right in pairwise(starts))


def test_a_plate_hangs_on_the_other_side_where_there_is_no_wall(tmp_path: Path) -> None:
    (plate,) = plates_of(nook(tmp_path, 0.3))
    assert plate.end_mm == pytest.approx(4000.0 - 70.0)
    assert plate.end_mm - plate.start_mm == pytest.approx(PLATE_WIDTH_MM)


@pytest.mark.parametrize(
    ("door", "text"),
    [
        ("352", "352"),
        ("364.double", "364"),
        ("340.cmptr.room", "340"),
        ("A342", "A342"),
        ("NE.men", "MEN"),
        ("303.second", "303"),
        ("o'brien-2", "OBRIE"),
        ("", ""),
        ("'", ""),
    ],
)
def test_what_stands_on_a_plate(door: str, text: str) -> None:
    assert plate_text(door) == text


@pytest.mark.parametrize(("node", "door"), [("352L", "352"), ("NE.men.R", "NE.men"), ("L", "L"), ("A", "A")])
def test_the_name_of_a_door_is_that_of_its_jambs(node: str, door: str) -> None:
    assert door_name(node) == door


def test_codes_have_no_two_ones_in_a_row() -> None:
    assert sorted(MARKER_CODES) == [code for code in range(8) if not code & (code << 1)]
