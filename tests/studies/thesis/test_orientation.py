from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.nav.mapping.wall_matching import wrap_deg
from studies.thesis.local_mapper import hallway_direction

angles = st.floats(-720.0, 720.0).map(lambda angle: round(angle * 8) / 8)  # so that sums are exact


@pytest.mark.parametrize(
    ("angle", "expected"), [(0, 0), (180, 180), (-180, 180), (190, -170), (540, 180), (-90, -90), (359, -1)]
)
def test_wrapped(angle: float, expected: float) -> None:
    assert wrap_deg(angle) == expected


@pytest.mark.parametrize(
    ("orientation", "goal", "expected"),
    [
        (3.0, 0.0, 3.0),
        (3.0, 180.0, -177.0),
        (-87.0, 90.0, 93.0),
        (-87.0, 270.0, -87.0),
        (1.0, 359.0, 1.0),
        (179.0, -2.0, -1.0),
        (0.0, 90.0, 0.0),  # both are equally near
        (0.0, -90.0, 0.0),
        (180.0, 90.0, 180.0),
    ],
)
def test_the_direction_nearer_to_the_goal(orientation: float, goal: float, expected: float) -> None:
    assert hallway_direction(orientation, goal) == expected


@given(orientation=angles, goal=angles)
def test_it_is_along_the_orientation_and_within_a_right_angle(orientation: float, goal: float) -> None:
    direction = hallway_direction(orientation, goal)
    assert (direction - orientation) % 180.0 == 0.0
    assert -180.0 < direction <= 180.0
    assert abs(wrap_deg(goal - direction)) <= 90.0
