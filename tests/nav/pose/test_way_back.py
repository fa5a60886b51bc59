"""How a robot moved of late: what it sees now and what it saw a while ago are of one way."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.nav.pose.steps import NOW, Step
from colony.nav.pose.way_back import KEPT_NS, WayBack

steps = st.lists(
    st.builds(Step, st.floats(-100, 100), st.floats(-20, 20), st.floats(-0.5, 0.5)), min_size=1, max_size=20
)


def after(pose: tuple[float, float, float], step: Step) -> tuple[float, float, float]:
    """Where a robot is after a step, in the plane."""
    x, y, heading = pose
    sine, cosine = math.sin(heading), math.cos(heading)
    return (
        x - step.ahead_mm * sine - step.left_mm * cosine,
        y + step.ahead_mm * cosine - step.left_mm * sine,
        heading + step.turned_rad,
    )


@given(steps, st.integers(0, 19))
def test_going_the_way_back_leads_to_where_the_robot_was(made: list[Step], back: int) -> None:
    way, poses = WayBack(), [(300.0, -200.0, 1.0)]
    way.begin(0)
    for k, step in enumerate(made, 1):
        way.go(k * 100, step)
        poses.append(after(poses[-1], step))
    then = max(len(made) - back, 0)
    since = way.since(then * 100)
    assert since is not None
    x, y, heading = poses[-1]
    sine, cosine = math.sin(heading), math.cos(heading)
    assert x + since.ahead_mm * sine + since.left_mm * cosine == pytest.approx(poses[then][0], abs=1e-6)
    assert y - since.ahead_mm * cosine + since.left_mm * sine == pytest.approx(poses[then][1], abs=1e-6)
    assert heading - since.turned_rad == pytest.approx(poses[then][2], abs=1e-9)
    way_mm = sum(math.hypot(s.ahead_mm, s.left_mm) for s in made[then:])
    assert since.way_mm == pytest.approx(way_mm, abs=1e-6)


def test_between_two_steps_it_is_on_the_way() -> None:
    way = WayBack()
    way.begin(0)
    way.go(100, Step(50.0, 0.0, 0.0))
    since = way.since(80)
    assert since is not None
    assert since == pytest.approx((10.0, 0.0, 0.0, 10.0))


def test_what_was_before_all_that_is_known_is_not_known_and_the_future_is_now() -> None:
    way = WayBack()
    way.begin(1_000)
    assert way.since(999) is None
    assert way.since(1_000) == NOW
    assert way.since(5_000) == NOW
    way.go(KEPT_NS + 2_000, Step(10.0, 0.0, 0.0))
    assert way.since(1_000) is None
