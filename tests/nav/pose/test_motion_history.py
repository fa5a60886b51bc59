"""How a robot moved of late: what it sees now and what it saw a while ago are of one way."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.nav.pose.pose import MAX_AGE_NS, NO_MOTION, MotionHistory, OdometryStep

steps = st.lists(
    st.builds(OdometryStep, st.floats(-100, 100), st.floats(-20, 20), st.floats(-0.5, 0.5)),
    min_size=1,
    max_size=20,
)


def after(pose: tuple[float, float, float], step: OdometryStep) -> tuple[float, float, float]:
    """Where a robot is after a step, in the plane."""
    x, y, heading = pose
    sine, cosine = math.sin(heading), math.cos(heading)
    return (
        x - step.ahead_mm * sine - step.left_mm * cosine,
        y + step.ahead_mm * cosine - step.left_mm * sine,
        heading + step.turned_rad,
    )


@given(steps, st.integers(0, 19))
def test_going_the_way_back_leads_to_where_the_robot_was(made: list[OdometryStep], back: int) -> None:
    history, poses = MotionHistory(), [(300.0, -200.0, 1.0)]
    history.restart(0)
    for k, step in enumerate(made, 1):
        history.add(k * 100, step)
        poses.append(after(poses[-1], step))
    then = max(len(made) - back, 0)
    motion = history.motion_since(then * 100)
    assert motion is not None
    x, y, heading = poses[-1]
    sine, cosine = math.sin(heading), math.cos(heading)
    assert x + motion.ahead_mm * sine + motion.left_mm * cosine == pytest.approx(poses[then][0], abs=1e-6)
    assert y - motion.ahead_mm * cosine + motion.left_mm * sine == pytest.approx(poses[then][1], abs=1e-6)
    assert heading - motion.turned_rad == pytest.approx(poses[then][2], abs=1e-9)
    travel_mm = sum(math.hypot(s.ahead_mm, s.left_mm) for s in made[then:])
    assert motion.travel_mm == pytest.approx(travel_mm, abs=1e-6)


def test_between_two_steps_it_is_on_the_way() -> None:
    history = MotionHistory()
    history.restart(0)
    history.add(100, OdometryStep(50.0, 0.0, 0.0))
    motion = history.motion_since(80)
    assert motion is not None
    assert motion == pytest.approx((10.0, 0.0, 0.0, 10.0))


def test_what_was_before_all_that_is_known_is_not_known_and_the_future_is_now() -> None:
    history = MotionHistory()
    history.restart(1_000)
    assert history.motion_since(999) is None
    assert history.motion_since(1_000) == NO_MOTION
    assert history.motion_since(5_000) == NO_MOTION
    history.add(MAX_AGE_NS + 2_000, OdometryStep(10.0, 0.0, 0.0))
    assert history.motion_since(1_000) is None
