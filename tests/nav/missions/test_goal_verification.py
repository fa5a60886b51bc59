"""What plates say of a goal."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from colony.nav.maps.signs import plates_of
from colony.nav.missions.goal_verification import (
    NEAR_MM,
    SeenPlate,
    Verdict,
    plate_at,
    seen_plate,
    verdict_of,
)
from tests.buildings import MSU

FLOOR = MSU
PLATE = next(plate for plate in plates_of(FLOOR) if plate.door == "376")


def seen(text: str, off_mm: float = 0.0) -> SeenPlate:
    return SeenPlate(1, 1, text, PLATE.middle.x + off_mm, PLATE.middle.y)


@pytest.mark.parametrize(
    ("plates", "verdict"),
    [
        ([], Verdict.UNSEEN),
        ([seen("376")], Verdict.RIGHT),
        ([seen("376", 800.0)], Verdict.RIGHT),
        ([seen("376", NEAR_MM + 1.0)], Verdict.UNSEEN),
        ([seen("374")], Verdict.WRONG),
        ([seen("374", 900.0)], Verdict.UNSEEN),
        ([seen("")], Verdict.UNSEEN),
        ([seen("374"), seen("376")], Verdict.RIGHT),
        ([seen("376", 100.0), seen("374", 2_000.0)], Verdict.RIGHT),
    ],
)
def test_the_plate_of_the_goal_near_its_place_is_right(plates: list[SeenPlate], verdict: Verdict) -> None:
    assert verdict_of(PLATE, plates) is verdict


@pytest.mark.parametrize("node", ["376L", "376R", "3:376R"])
def test_the_plate_of_a_goal_is_that_of_its_door(node: str) -> None:
    assert plate_at(FLOOR, node) == PLATE


def test_who_has_no_plate_has_none() -> None:
    assert plate_at(FLOOR, "nowhere") is None
    assert plate_at(replace(FLOOR, rings=()), "376L") is None


@pytest.mark.parametrize(
    "told", [None, [], [1, 1, "376", 0.0], [1, 1, 376, 0.0, 0.0], [1.5, 1, "376", 0.0, 0.0], "plate"]
)
def test_what_is_no_plate_is_none(told: object) -> None:
    assert seen_plate(told) is None


def test_a_plate_comes_back_as_it_was() -> None:
    assert seen_plate([1, 2, "376", 3, 4.5]) == SeenPlate(1, 2, "376", 3.0, 4.5)
    assert seen_plate([1, 2, "376", 3, math.inf]) is None
