"""Where the robot really was at a time."""

from __future__ import annotations

import pytest

from colony.nav.maps.stickrep.model import Pose
from studies.true_path import TruePath


def test_the_newest_frame_that_is_not_after_a_time() -> None:
    path = TruePath()
    for k in range(5):
        path.add(100 * k, Pose(float(k), 0.0, 0.0))
    assert [path.at(t).x_mm for t in (-5, 0, 99, 100, 250, 400, 10_000)] == [0, 0, 0, 1, 2, 4, 4]


def test_before_any_frame_there_is_no_place() -> None:
    with pytest.raises(ValueError, match="no pose"):
        TruePath().at(0)
