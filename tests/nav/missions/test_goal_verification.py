"""What plates say of a goal."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from colony.nav.maps.signs import plates_of
from colony.nav.missions.goal_verification import (
    SAME_PLATE_MM,
    GoalVerdict,
    ReportedPlate,
    plate_at,
    reported_plate,
    verdict_of,
)
from tests.buildings import MSU

FLOOR = MSU
PLATE = next(plate for plate in plates_of(FLOOR) if plate.door == "376")


def seen(text: str, off_mm: float = 0.0) -> ReportedPlate:
    return ReportedPlate(1, 1, text, PLATE.center.x + off_mm, PLATE.center.y)


@pytest.mark.parametrize(
    ("plates", "verdict"),
    [
        ([], GoalVerdict.UNSEEN),
        ([seen("376")], GoalVerdict.RIGHT),
        ([seen("376", 800.0)], GoalVerdict.RIGHT),
        ([seen("376", SAME_PLATE_MM + 1.0)], GoalVerdict.UNSEEN),
        ([seen("374")], GoalVerdict.WRONG),
        ([seen("374", 900.0)], GoalVerdict.UNSEEN),
        ([seen("")], GoalVerdict.UNSEEN),
        ([seen("374"), seen("376")], GoalVerdict.RIGHT),
        ([seen("376", 100.0), seen("374", 2_000.0)], GoalVerdict.RIGHT),
    ],
)
def test_the_plate_of_the_goal_near_its_place_is_right(
    plates: list[ReportedPlate], verdict: GoalVerdict
) -> None:
    assert verdict_of(PLATE, plates) is verdict


@pytest.mark.parametrize("node", ["376L", "376R", "3:376R"])
def test_the_plate_of_a_goal_is_that_of_its_door(node: str) -> None:
    assert plate_at(FLOOR, node) == PLATE


def test_who_has_no_plate_has_none() -> None:
    assert plate_at(FLOOR, "nowhere") is None
    assert plate_at(replace(FLOOR, rings=()), "376L") is None


@pytest.mark.parametrize(
    "value", [None, [], [1, 1, "376", 0.0], [1, 1, 376, 0.0, 0.0], [1.5, 1, "376", 0.0, 0.0], "plate"]
)
def test_what_is_no_plate_is_none(value: object) -> None:
    assert reported_plate(value) is None


def test_a_plate_comes_back_as_it_was() -> None:
    assert reported_plate([1, 2, "376", 3, 4.5]) == ReportedPlate(1, 2, "376", 3.0, 4.5)
    assert reported_plate([1, 2, "376", 3, math.inf]) is None
