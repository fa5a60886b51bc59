"""Which plates were passed: the truth that plate finders are held against."""

from __future__ import annotations

import numpy as np
import pytest

from colony.nav.maps.signs import PLATE_WIDTH_MM, Plate
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import Pose
from studies.plates.passed import Pass, PassMonitor

STEP_MM, STEP_NS = 50.0, 100_000_000


def _plate(x_mm: float = 0.0, y_mm: float = 10_000.0, heading_deg: float = 90.0) -> Plate:
    """On a wall to the west of somebody who goes north, as far as it is told otherwise."""
    return Plate(
        edge=0, start_mm=0.0, end_mm=PLATE_WIDTH_MM, center=Point(x_mm, y_mm), heading_deg=heading_deg,
        door="1", text="1",
    )  # fmt: skip


def _driven(
    plate: Plate,
    *,
    aside_mm: float = 1000.0,
    turned_deg: float = 0.0,
    upto_mm: float = 20_000.0,
    walls: tuple[tuple[float, ...], ...] = ((0.0, 0.0, 0.0, 20_000.0),),
) -> tuple[Pass, ...]:
    """North along x = `aside_mm`, the heading turned; half a meter a second."""
    watch = PassMonitor([plate], np.array(walls).reshape(-1, 4))
    for k in range(round(upto_mm / STEP_MM)):
        watch.update(k * STEP_NS, Pose(aside_mm, k * STEP_MM, turned_deg % 360.0))
    return watch.passes


def test_a_plate_is_passed_abeam_and_in_view_before_and_after() -> None:
    [passed] = _driven(_plate())
    assert passed.at_ns == pytest.approx(20.0 * 1e9, abs=STEP_NS)
    # Both ends are in a field of 60 degrees for 2 tan 30 m less a plate's width.
    expected_s = (2 * 1000.0 * np.tan(np.pi / 6) - PLATE_WIDTH_MM) / 500.0
    assert passed.in_view_ns / 1e9 == pytest.approx(expected_s, abs=0.11)


def test_one_on_the_right_one_too_far_away_and_one_ahead_are_not_passed() -> None:
    assert _driven(_plate(2000.0, heading_deg=270.0)) == ()
    assert _driven(_plate(), aside_mm=2600.0) == ()
    assert _driven(_plate(), upto_mm=9_900.0) == ()


@pytest.mark.parametrize("wall", [(500.0, 9_000.0, 500.0, 11_000.0), (20.5, 0.0, 20.5, 20_000.0)])
def test_a_wall_in_between_hides_it(wall: tuple[float, ...]) -> None:
    assert _driven(_plate(), walls=(wall,)) == ()


def test_a_robot_that_is_turned_too_far_passes_it_out_of_view() -> None:
    [half] = _driven(_plate(), turned_deg=25.0)
    [turned] = _driven(_plate(), turned_deg=52.0)
    assert half.in_view_ns > 0
    assert turned.in_view_ns == 0
    assert _driven(_plate(), turned_deg=95.0) == ()


def test_a_tilted_robot_sees_it_elsewhere_but_passes_it_at_the_same_time() -> None:
    [straight], [left] = _driven(_plate()), _driven(_plate(), turned_deg=-20.0)
    assert left.at_ns == straight.at_ns


def test_a_plate_that_is_passed_twice_counts_once() -> None:
    watch = PassMonitor([_plate()], np.zeros((0, 4)))
    for lap in range(2):
        for k in range(400):
            watch.update((lap * 400 + k) * STEP_NS, Pose(1000.0, k * STEP_MM, 0.0))
    assert len(watch.passes) == 1


def test_no_plates_no_passes() -> None:
    watch = PassMonitor([], np.zeros((0, 4)))
    watch.update(0, Pose(0.0, 0.0, 0.0))
    watch.update(1, Pose(0.0, 1.0, 0.0))
    assert watch.passes == ()
