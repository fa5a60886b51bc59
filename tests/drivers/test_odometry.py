"""Registers that wrap, implausible steps, and arcs."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.drivers.dialect import ImplausibleError
from colony.drivers.odometry import RESTARTS_AFTER, OdometryPose, Registers, along_arc, wrapped_difference

SECOND = 1_000_000_000


@given(st.integers(0, 2**40), st.data(), st.sampled_from([12, 15, 16]))
def test_any_step_below_half_of_the_register_is_found(old: int, data: st.DataObject, bits: int) -> None:
    step = data.draw(st.integers(-(1 << bits - 1), (1 << bits - 1) - 1))
    mask = (1 << bits) - 1
    assert wrapped_difference((old + step) & mask, old & mask, bits) == step
    assert wrapped_difference(old + step, old, bits) == step  # bits above are ignored


def test_registers_go_on_after_an_implausible_step() -> None:
    registers = Registers(16, 16, max_rate=1000.0)
    assert registers.step((65_530, 0), 0) == ((0, 0), 0.0)
    with pytest.raises(ImplausibleError, match=r"\(65530, 0\) became \(30000, 0\) within 0.100 s"):
        registers.step((30_000, 0), SECOND // 10)
    assert registers.step((4, 7), SECOND // 5) == ((10, 7), 0.2)


def test_registers_of_a_device_that_was_switched_off_begin_again() -> None:
    registers = Registers(16, max_rate=100.0)
    registers.step((20_000,), 0)
    for i in range(RESTARTS_AFTER):
        with pytest.raises(ImplausibleError):
            registers.step((i,), i)
    assert registers.step((RESTARTS_AFTER,), RESTARTS_AFTER)[0] == (1,)


def test_restarted_registers_do_not_jump() -> None:
    registers = Registers(15, max_rate=100.0)
    registers.step((100,), 0)
    registers.restart()
    assert registers.step((9000,), 1) == ((0,), 0.0)


def test_a_quarter_circle_to_the_left() -> None:
    pose = along_arc(
        OdometryPose(), 1000.0 * math.pi / 2, 90.0
    )  # from north, around a center 1 m to the west
    assert (pose.x, pose.y, pose.heading) == (pytest.approx(-1000.0), pytest.approx(1000.0), 90.0)


@given(st.floats(-500, 500), st.floats(-170, 170), st.floats(0, 359))
def test_an_arc_is_the_limit_of_short_straight_lines(distance: float, turned: float, heading: float) -> None:
    pose = end = OdometryPose(heading=heading)
    for _ in range(2000):
        middle = math.radians(pose.heading + turned / 4000)
        step = distance / 2000
        pose = OdometryPose(
            pose.x - step * math.sin(middle), pose.y + step * math.cos(middle), pose.heading + turned / 2000
        )
    end = along_arc(end, distance, turned)
    assert math.hypot(end.x - pose.x, end.y - pose.y) < 1e-3
