"""An estimate survives DServer, and what is no estimate is none."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.nav.pose.pose import PoseEstimate, pose_list, pose_of

numbers = st.floats(allow_nan=False, allow_infinity=False)
POSE = PoseEstimate(5, 1.0, 2.0, 90.0, 400.0, 30.0, 0.0, 100.0, 0.0, 0.25)


@given(st.integers(0, 2**62), st.lists(numbers, min_size=9, max_size=9))
def test_an_estimate_comes_back_as_it_was(t_ns: int, rest: list[float]) -> None:
    pose = PoseEstimate(t_ns, *rest)
    assert pose_of(pose_list(pose)) == pose


@pytest.mark.parametrize(
    "value", [None, 3.0, [], [1.0] * 9, [1.0] * 11, [math.nan] * 10, ["1"] * 10, {"t": 1}, [[1.0] * 10]]
)
def test_what_is_no_estimate_is_none(value: object) -> None:
    assert pose_of(value) is None


def test_how_sure_it_is_along_a_direction() -> None:
    assert POSE.sigma_along(1.0, 0.0) == 20.0
    assert POSE.sigma_along(0.0, 1.0) == 10.0
    assert POSE.sigma_along(0.6, 0.8) == pytest.approx(math.sqrt(400 * 0.36 + 2 * 30 * 0.48 + 100 * 0.64))
    assert POSE.sigma_deg == 0.5
