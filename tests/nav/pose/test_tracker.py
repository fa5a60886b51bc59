from __future__ import annotations

import math

import pytest

from colony.nav.pose.tracker import Correction, position_at, step_between
from colony.runtime.library.robot import Position

HERE = Position(x=1_000.0, y=2_000.0, heading=90.0, t_ns=1_000)


def test_a_step_is_in_the_frame_of_the_robot_before_it() -> None:
    step = step_between(HERE, Position(x=900.0, y=1_990.0, heading=100.0, t_ns=2_000))
    assert step == pytest.approx((100.0, 10.0, math.radians(10.0)))


def test_a_step_across_north_is_short() -> None:
    west = Position(x=0.0, y=0.0, heading=359.0, t_ns=0)
    east = Position(x=0.0, y=0.0, heading=2.0, t_ns=1)
    assert step_between(west, east).turned_rad == pytest.approx(math.radians(3.0))
    assert step_between(east, west).turned_rad == pytest.approx(math.radians(-3.0))


@pytest.mark.parametrize(
    ("t_ns", "part"), [(1_500, -0.5), (2_000, 0.0), (2_200, 0.2), (0, -1.0), (9_000, 1.0)]
)
def test_where_the_robot_was_when_it_scanned(t_ns: int, part: float) -> None:
    now = Position(x=1_100.0, y=2_000.0, heading=80.0, t_ns=2_000)
    at = position_at(t_ns, now, HERE)
    assert (at.x, at.y, at.heading) == pytest.approx((1_100.0 + 100.0 * part, 2_000.0, 80.0 - 10.0 * part))


def test_the_first_position_is_taken_as_it_is() -> None:
    assert position_at(5_000, HERE, None) is HERE
    assert position_at(5_000, HERE, HERE) is HERE


def test_small_corrections_are_not_worth_telling() -> None:
    assert not Correction(x_mm=2.0, y_mm=-2.0, heading_deg=0.1).is_significant
    assert Correction(x_mm=3.0, y_mm=-3.0, heading_deg=0.0).is_significant
    assert Correction(x_mm=0.0, y_mm=0.0, heading_deg=-0.2).is_significant
