"""Two simulators of which neither knows the other: what they say of the same robot is the same."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="extra mujoco not installed")

from tests.sampling import sampled
from tests.sim.mujoco.agreement import (
    SLANTED,
    both,
    compared_drive,
    range_differences,
    slid_mm,
    stopped_within_mm,
)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_short_drive(seed: int) -> None:
    found = compared_drive(seed, seconds=5.0)
    print(found)
    assert found.way_mm > 500.0
    assert found.way < 0.01
    assert found.heading_deg < 1.0
    assert found.place_mm < 20.0


def test_ranges_at_equal_poses() -> None:
    differences = range_differences(seed=1, poses=3)
    assert len(differences) == 3 * 360
    assert differences.max() < 1.0


def test_braking() -> None:
    """A body brakes from 1 m/s within 500 mm; neither is off by more than a slice of its motion."""
    assert [stopped_within_mm(world) for world in both(np.empty((0, 4)))] == pytest.approx(
        [500.0, 500.0], abs=10.0
    )


def test_where_they_differ_at_walls() -> None:
    """Our robot stops where it touches; that in MuJoCo slides along, as its bumper is smooth."""
    ours, theirs = (slid_mm(world) for world in both(SLANTED))
    assert ours < 20.0
    assert theirs > 50.0


@pytest.mark.long
@pytest.mark.parametrize("seed", sampled(range(1, 6), every=5, thorough=True))
def test_a_minute(seed: int) -> None:
    found = compared_drive(seed, seconds=60.0)
    print(found)
    assert found.way < 0.02
    assert found.heading_deg < 3.0


@pytest.mark.long
def test_ranges_at_many_poses() -> None:
    differences = range_differences(seed=2, poses=40)
    assert (differences <= 20.0).mean() >= 0.95
