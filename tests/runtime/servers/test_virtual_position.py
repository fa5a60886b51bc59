"""Positions beyond what registers hold, and as users set them."""

from __future__ import annotations

import math
import random

import pytest

from colony.runtime.arbitration.motion import OdometerPose
from colony.runtime.servers.base import Odometer, VirtualAxis
from colony.runtime.servers.drivers import BaseState

HALF = 1 << 15


def register(value: float) -> float:
    return float((round(value) + HALF) % (2 * HALF) - HALF)


def state(x: float, y: float = 0.0, heading: float = 0.0) -> BaseState:
    return BaseState(
        t_ns=0,
        x=x,
        y=y,
        heading=heading,
        front_bumper=False,
        rear_bumper=False,
        speed=0.0,
        turn_rate=0.0,
        wheel_speed=0.0,
    )


STEPS = [
    # what the register shows, one look after the other, and the position after the last
    ("no overflow", (32767,), 32767),
    ("over the top", (32767, -32768), 32768),
    ("and on", (32000, -32000, 0, 32000, -32000), 32000 + 2 * 65536 - 64000),
    ("under the bottom", (-32768, 32767), -32769),
    ("there and back", (32000, -32000, 32000), 32000),
    ("a change of sign alone is none", (16000, -16000), -16000),
    ("exactly half is none", (16384, -16384), -16384),
    ("one more is one", (16385, -16384), 65536 - 16384),
    ("exactly half downward is none", (-16384, 16384), 16384),
    ("zero is positive: down to it from above", (30000, 0), 0),
    ("zero is positive: far down from it", (0, -32768), -32768),
    ("far up to zero from below is exactly half", (-32768, 0), 0),
    ("far away without a change of sign", (1, 32767), 32767),
]


@pytest.mark.parametrize(("shown", "expected"), [s[1:] for s in STEPS], ids=[s[0] for s in STEPS])
def test_overflow(shown: tuple[int, ...], expected: int) -> None:
    axis = VirtualAxis(16)
    assert [axis.extend(float(v)) for v in shown][-1] == expected


def test_any_walk_is_followed_beyond_32_bits_while_no_step_reaches_half_the_range() -> None:
    chance = random.Random(4)
    axis, x = VirtualAxis(16), 0.0
    for _ in range(200_000):
        x = round(x + chance.uniform(-16_000, 32_767))
        assert axis.extend(register(x)) == x
    assert x > 1 << 30
    for _ in range(2000):
        x = round(x - chance.uniform(0, 32_767))
        assert axis.extend(register(x)) == x


def test_after_a_reset_a_register_is_taken_as_it_is() -> None:
    axis = VirtualAxis(16)
    assert [axis.extend(v) for v in (32000.0, -32000.0)] == [32000.0, 33536.0]
    axis.reset()
    assert axis.extend(-32000.0) == -32000.0
    assert axis.extend(32000.0) == -33536.0


def test_registers_that_never_overflow_are_left_alone() -> None:
    axis = VirtualAxis(None)
    assert [axis.extend(v) for v in (1e9, -1e9, 0.5)] == [1e9, -1e9, 0.5]


def test_poses_as_set_go_on_from_there_along_the_new_heading() -> None:
    odometer = Odometer(None)
    assert odometer.observe(state(100.0, 200.0, 350.0)) == (100.0, 200.0, 350.0)
    odometer.set(state(100.0, 200.0, 350.0), OdometerPose(1000.0, 0.0, 80.0))
    here = odometer.observe(state(100.0, 200.0, 350.0))
    assert here == pytest.approx((1000.0, 0.0, 80.0))
    angle = math.radians(350.0)  # 10 mm ahead, as the base sees it
    ahead = odometer.observe(state(100.0 - 10 * math.sin(angle), 200.0 + 10 * math.cos(angle), 355.0))
    at = math.radians(80.0)
    assert ahead == pytest.approx((1000.0 - 10 * math.sin(at), 10 * math.cos(at), 85.0))


def test_adjusting_adds_and_can_be_repeated() -> None:
    odometer = Odometer(16)
    odometer.observe(state(0.0))
    for _ in range(3):
        odometer.adjust(state(0.0), OdometerPose(10.0, -5.0, 150.0))
    assert odometer.observe(state(0.0)) == pytest.approx((30.0, -15.0, 90.0))


def test_setting_forgets_overflows_and_motions_do_not_notice() -> None:
    odometer = Odometer(16)
    for x in (0.0, 30000.0, -30000.0):  # 35536 mm in truth
        odometer.observe(state(x))
    assert odometer.continuous_pose == OdometerPose(35536.0, 0.0, 0.0)
    odometer.set(state(-30000.0), OdometerPose(5.0, 6.0, 0.0))
    assert odometer.observe(state(-29990.0)) == pytest.approx((15.0, 6.0, 0.0))
    assert odometer.continuous_pose == OdometerPose(35546.0, 0.0, 0.0)
    assert odometer.observe(state(-32768.0)) == pytest.approx((5.0 - 2768.0, 6.0, 0.0))
    assert odometer.observe(state(32767.0)) == pytest.approx((5.0 - 2769.0, 6.0, 0.0))


def test_the_track_turns_on_beyond_a_full_turn() -> None:
    odometer = Odometer(None)
    for heading in range(0, 1081, 40):
        odometer.observe(state(0.0, 0.0, heading % 360.0))
    assert odometer.continuous_pose == pytest.approx((0.0, 0.0, 1080.0))
