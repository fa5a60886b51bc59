from __future__ import annotations

import math

import numpy as np
import pytest

from colony.nav.mapping.himm import MAX_CERTAINTY, HimmMap, HimmParameters, LocalPose
from tests.nav.sonars import CHANNELS

SILENT = 10_000.0
ORIGIN = LocalPose(0.0, 0.0, 0.0)
SMALL = HimmParameters(half_side_mm=4_000.0)


def one(channel: int, range_mm: float) -> np.ndarray:
    """A scan in which one sonar has an echo."""
    ranges = np.full(CHANNELS, SILENT)
    ranges[channel] = range_mm
    return ranges


def test_a_reading_marks_the_cell_on_the_axis() -> None:
    local = HimmMap(SMALL)
    local.mark(ORIGIN, one(12, 1_500.0))
    cells = local.cells()
    assert (cells.ahead_mm.tolist(), cells.certainty.tolist()) == ([1_850.0], [3.0])
    assert abs(cells.left_mm[0]) == 50.0


@pytest.mark.parametrize(("channel", "ahead", "left"), [(18, 0.0, 1.0), (0, -1.0, 0.0), (6, 0.0, -1.0)])
def test_sonars_look_where_they_look(channel: int, ahead: float, left: float) -> None:
    local = HimmMap(SMALL)
    local.mark(LocalPose(130.0, 130.0, 0.0), one(channel, 1_500.0))
    cells = local.cells()
    assert cells.ahead_mm == pytest.approx([130.0 + 1_860.0 * ahead], abs=50.0)
    assert cells.left_mm == pytest.approx([130.0 + 1_860.0 * left], abs=50.0)


def test_the_pose_turns_and_moves_a_reading() -> None:
    local = HimmMap(SMALL)
    local.mark(LocalPose(500.0, -300.0, math.radians(90.0)), one(12, 1_000.0))
    cells = local.cells()
    assert cells.ahead_mm == pytest.approx([500.0], abs=51.0)
    assert cells.left_mm == pytest.approx([-300.0 + 1_360.0], abs=50.0)


def test_certainty_rises_by_three_up_to_fifteen() -> None:
    local = HimmMap(SMALL)
    for count in range(1, 8):
        local.mark(ORIGIN, one(12, 1_500.0))
        assert local.cells().certainty.tolist() == [min(3.0 * count, MAX_CERTAINTY)]
    assert local.grid.dtype == np.uint8


def test_what_is_before_an_echo_is_worn_down_by_one() -> None:
    local = HimmMap(SMALL)
    local.mark(ORIGIN, one(12, 1_000.0))
    left = []
    for _ in range(4):
        local.mark(ORIGIN, one(12, 2_500.0))
        left.append(local.grid[40 + 13].max())
    assert left == [2, 1, 0, 0]


@pytest.mark.parametrize("bearing", [0.0, 10.0, 33.0, 45.0, 80.0])
def test_each_cell_of_an_axis_is_lowered_once(bearing: float) -> None:
    local = HimmMap(SMALL)
    local._grid[:] = 10
    local.mark(LocalPose(0.0, 0.0, math.radians(bearing)), one(12, 2_900.0))
    lowered = local.grid[local.grid < 10]
    assert set(lowered.tolist()) == {9}
    assert len(lowered) == pytest.approx(
        29 * max(math.cos(math.radians(bearing)), math.sin(math.radians(bearing))), abs=2
    )


def test_silence_changes_nothing() -> None:
    local = HimmMap(SMALL)
    local.mark(ORIGIN, one(12, 1_500.0))
    before = local.grid
    local.mark(ORIGIN, np.full(CHANNELS, SILENT))
    assert (local.grid == before).all()


def test_an_echo_beyond_the_reach_clears_and_marks_nothing() -> None:
    local = HimmMap(SMALL)
    local.mark(ORIGIN, one(12, 1_500.0))
    local.mark(ORIGIN, one(12, 5_000.0))
    assert local.grid.max() == 2


def test_what_is_outside_of_the_map_is_left_out() -> None:
    local = HimmMap(HimmParameters(half_side_mm=1_000.0))
    local.mark(ORIGIN, np.full(CHANNELS, 2_500.0))
    local.mark(LocalPose(50_000.0, -50_000.0, 1.0), np.full(CHANNELS, 500.0))
    assert local.grid.max() == 0


def test_clear() -> None:
    local = HimmMap(SMALL)
    local.mark(ORIGIN, one(12, 1_500.0))
    local.clear()
    assert len(local.cells().certainty) == 0
