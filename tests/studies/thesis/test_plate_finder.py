from __future__ import annotations

import math
from dataclasses import replace

import pytest

from colony.nav.shared import GOAL_DIRECTION
from colony.vision.level_camera import SIDE
from colony.vision.plates.observations import FoundPlate
from studies.thesis.plate_finder import ThesisSearch, thesis_plate_finder
from tests.vision.plates.hall import Hall, Stage
from tests.vision.plates.test_search import WALL_MM, view
from tests.vision.plates.walls import plate

HALL = Hall(boards=(plate("352", 0.0),))
TWO_PLATES = Hall(boards=(plate("352", -600.0), plate("354", 700.0)))


def found_in(hall: Hall, distance_mm: float | None) -> list[FoundPlate]:
    search = ThesisSearch(SIDE)
    return [found for step in range(29) for found in search.update(view(hall, step), distance_mm).plates]


def run(hall: Hall) -> tuple[Stage, list[FoundPlate]]:
    reported: list[FoundPlate] = []
    stage = Stage(hall, plates=thesis_plate_finder(on_plate=reported.append, reader=None))
    stage.tell(GOAL_DIRECTION, 0.0)
    stage.run(7.0)
    return stage, reported


def test_a_plate_is_reported_once_at_the_first_observation() -> None:
    [found] = found_in(HALL, WALL_MM)
    assert (found.images, found.door) == (1, None)
    assert found.place == pytest.approx((-WALL_MM, 0.0), abs=120.0)


def test_a_search_needs_a_moderate_tilt() -> None:
    seen = view(HALL, 14)
    assert len(ThesisSearch(SIDE).update(seen, WALL_MM).plates) == 1
    assert ThesisSearch(SIDE).update(seen._replace(tilt_deg=None), WALL_MM).plates == ()
    assert ThesisSearch(SIDE).update(seen._replace(tilt_deg=55.0), WALL_MM).plates == ()


@pytest.mark.parametrize("distance_mm", [None, math.inf, math.nan, 0.0, -1.0])
def test_a_search_without_a_distance_of_the_wall_finds_nothing(distance_mm: float | None) -> None:
    assert found_in(HALL, distance_mm) == []


def test_the_finder_locks_the_camera_for_each_image() -> None:
    stage, reported = run(TWO_PLATES)
    assert [found.images for found in reported] == [1] * len(reported)
    assert {round(found.place[1], -2) for found in reported} <= {-600.0, 700.0}
    calls = [name for name in stage.asked if "period" not in name and name != "size"]
    assert calls == ["lock", "grab_rows", "unlock"] * (len(calls) // 3)
    assert len(calls) >= 3 * 10


def test_the_finder_goes_on_after_servers_were_away() -> None:
    _, reported = run(replace(TWO_PLATES, silent_s=(0.0, 4.4)))
    assert [round(found.place[1], -2) for found in reported] == [700.0]
