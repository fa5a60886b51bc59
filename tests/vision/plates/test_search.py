from __future__ import annotations

import math
from dataclasses import replace

import pytest

from colony.nav.maps.signs import Plate
from colony.nav.maps.stickrep.model import Pose
from colony.vision.detections import PlateBox, PlateReading
from colony.vision.gray_images import Gray
from colony.vision.level_camera import SIDE
from colony.vision.plates.observations import FoundPlate
from colony.vision.plates.search import (
    SETTLED_OBSERVATIONS,
    FloorPlates,
    PlateSearch,
    View,
    is_too_steep,
)
from studies.thesis.wall_view import WallView
from tests.vision.plates.hall import Hall, known
from tests.vision.plates.walls import Board, plate, wall_image

WALL_MM = 1500.0


def view(hall: Hall, step: int, tilt: float = 0.0) -> View:
    """What is seen 125 mm further on each step."""
    here = hall.start_mm + 125.0 * step
    boards = [replace(board, place_mm=here - board.place_mm) for board in hall.boards]
    image = wall_image(boards, WallView(hall.wall_mm, tilt), seed=step)
    return View(step * 250_000_000, image[27:93], 27, Pose(0.0, here, tilt), tilt)


def searched(
    hall: Hall, search: PlateSearch, plates: tuple[Plate, ...] | None = None, steps: int = 29
) -> list[FoundPlate]:
    reported: list[FoundPlate] = []
    for step in range(steps):
        reported += search.update(
            view(hall, step), None if plates is None else FloorPlates(plates, 300.0)
        ).plates
    return reported


HALL = Hall(boards=(plate("352", -600.0), plate("354", 500.0)))
POSTER = Board(place_mm=0.0, width_mm=300.0, height_mm=180.0, text=("IEEE", "MEETING"), character_mm=45.0)


def test_each_plate_is_told_once_and_where_it_is() -> None:
    reported = searched(HALL, PlateSearch(SIDE))
    assert [found_plate.place for found_plate in reported] == [
        pytest.approx((-WALL_MM, place), abs=40.0) for place in (-600.0, 500.0)
    ]
    assert all(found_plate.images >= SETTLED_OBSERVATIONS for found_plate in reported)
    assert all((found_plate.text, found_plate.door) == ("", None) for found_plate in reported)


def test_a_plate_at_the_same_place_on_another_floor_is_another_one() -> None:
    search = PlateSearch(SIDE)
    there = [view(HALL, step)._replace(floor="2") for step in range(29)]
    back = [view(HALL, 28 - step)._replace(floor="3", t_ns=(29 + step) * 250_000_000) for step in range(29)]
    looks = (*there, *back)
    reported = [found_plate for look in looks for found_plate in search.update(look).plates]
    assert len(reported) == 4


def test_a_poster_is_none() -> None:
    assert searched(replace(HALL, boards=(POSTER,)), PlateSearch(SIDE)) == []


def test_something_of_half_the_size_is_none() -> None:
    small = Board(place_mm=0.0, width_mm=230.0, height_mm=82.0, text=("352",), character_mm=57.0)
    assert searched(replace(HALL, boards=(small,)), PlateSearch(SIDE)) == []


def test_a_plate_is_told_when_it_is_out_of_view_if_the_looks_were_few() -> None:
    search = PlateSearch(SIDE)
    hall = replace(HALL, boards=(plate("352", 0.0),), start_mm=-150.0)
    reported = [found_plate for step in range(4) for found_plate in search.update(view(hall, step)).plates]
    assert reported == []
    turned = View(5 * 10**9, None, 0, Pose(0.0, 300.0, 60.0), 60.0)
    (found_plate,) = search.update(turned).plates
    assert found_plate.images == 4
    assert search.update(turned).plates == ()


def test_nothing_is_looked_for_at_steep_angles() -> None:
    steep = view(HALL, 8)._replace(tilt_deg=55.0)
    assert PlateSearch(SIDE).update(steep) == ((), ())


def test_what_is_read_counts_by_all_looks() -> None:
    seen: list[tuple[int, ...]] = []

    def reader(image: Gray, box: PlateBox) -> PlateReading:
        seen.append(image.shape)
        # The first look is misread.
        return PlateReading("362", 0.6) if len(seen) == 1 else PlateReading("352", 0.9)

    hall = replace(HALL, boards=(plate("352", 0.0),))
    (found_plate,) = searched(hall, PlateSearch(SIDE, reader))
    assert found_plate.text == "352"
    assert found_plate.confidence > 0.99
    assert set(seen) == {(66, 240)}


def test_with_the_map_plates_have_names_and_tell_the_pose() -> None:
    search = PlateSearch(SIDE)
    reported, fixes = [], []
    for step in range(29):
        found = search.update(view(HALL, step), FloorPlates(known(HALL), 300.0))
        reported += [found_plate.door for found_plate in found.plates]
        fixes += [(step, fix) for fix in found.fixes]
    assert reported == ["352", "354"]
    assert len(fixes) > 10
    for step, fix in fixes:
        x, y, heading = 0.0, HALL.start_mm + 125.0 * step, 0.0
        assert fix.t_ns == step * 250_000_000
        for row in fix.rows:
            off = row.cx * x + row.cy * y + row.ch * math.radians(heading) - row.value
            assert abs(off) < row.sigma


def test_with_the_map_what_hangs_elsewhere_is_none() -> None:
    moved = tuple(replace(hung, center=hung.center._replace(y=hung.center.y + 700.0)) for hung in known(HALL))
    assert searched(HALL, PlateSearch(SIDE), moved) == []


def test_what_reads_now_as_this_and_now_as_that_is_no_plate() -> None:
    texts = iter("W00 NFD W60 NFOD W00 N0 NFOD I W00 NFD N0 W60 NFOD N W0 W00".split())

    def reader(image: Gray, box: PlateBox) -> PlateReading:
        return PlateReading(next(texts), 0.5)

    hall = replace(HALL, boards=(plate("352", 0.0),))
    assert searched(hall, PlateSearch(SIDE, reader)) == []
    assert searched(hall, PlateSearch(SIDE, lambda image, box: PlateReading("", 0.9))) == []
    assert len(searched(hall, PlateSearch(SIDE, lambda image, box: PlateReading("", 0.9)), known(hall))) == 1


@pytest.mark.parametrize(
    ("tilt", "steep"),
    [(0.0, False), (49.9, False), (-49.9, False), (50.0, True), (-50.0, True), (180.0, True)],
)
def test_nothing_is_done_at_steep_angles(tilt: float, steep: bool) -> None:
    assert is_too_steep(tilt) is steep


def test_an_unknown_angle_is_steep() -> None:
    assert is_too_steep(math.nan)
