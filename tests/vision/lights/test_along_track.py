from __future__ import annotations

import math

import numpy as np
import pytest

from colony.vision.lights.track import OdometryScale, TrackEstimate

LANDMARK_MM2 = 20.0**2


def test_a_landmark_takes_most_of_the_error_away() -> None:
    known = TrackEstimate().moved(2500.0).updated(120.0, LANDMARK_MM2)
    assert known.progress_mm == pytest.approx(2620.0, abs=3.0)
    assert known.sigma_mm < 20.0


def test_the_place_becomes_less_certain_with_the_way_back_and_forth() -> None:
    known = TrackEstimate().updated(0.0, LANDMARK_MM2)
    spread = [known.moved(at).sigma_mm for at in (0.0, 1000.0, 5000.0, -5000.0)]
    assert spread[0] < spread[1] < spread[2]
    assert spread[2] == pytest.approx(spread[3])


def test_the_scale_is_learned_from_landmark_to_landmark() -> None:
    reckoning, error = TrackEstimate(), 0.0
    for step in range(1, 6):
        error = -0.015 * 5500.0 * step
        reckoning = reckoning.moved(5500.0 * step).updated(error, LANDMARK_MM2)
    assert reckoning.scale.error == pytest.approx(-0.015, abs=0.001)
    assert math.sqrt(reckoning.scale.variance) < 0.002
    assert reckoning.moved(33000.0).error_mm == pytest.approx(-0.015 * 33000.0, abs=12.0)


def test_a_slip_moves_the_place_and_not_the_scale() -> None:
    scale = OdometryScale(error=0.004, variance=0.001**2)
    reckoning = TrackEstimate(scale=scale).updated(0.0, LANDMARK_MM2)
    slipped = reckoning.moved(5000.0).updated(20.0 - 150.0, LANDMARK_MM2)
    assert slipped.error_mm == pytest.approx(-130.0, abs=10.0)
    assert slipped.scale == scale


def test_what_is_told_to_the_odometry_is_no_error_any_more() -> None:
    reckoning = TrackEstimate(scale=OdometryScale(error=0.01)).moved(5000.0).updated(40.0, LANDMARK_MM2)
    corrected = reckoning.corrected(reckoning.error_mm)
    assert corrected.error_mm == 0.0
    assert corrected.progress_mm == pytest.approx(reckoning.progress_mm)
    after, uncorrected = corrected.moved(corrected.at_mm + 700.0), reckoning.moved(5700.0)
    assert after.progress_mm == pytest.approx(uncorrected.progress_mm)
    assert after.sigma_mm == pytest.approx(uncorrected.sigma_mm)


def test_the_filter_is_as_good_as_it_says() -> None:
    seed = 11
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    off = []
    for _ in range(300):
        scale, error, at = rng.normal(0.0, 0.012), rng.normal(0.0, 150.0), 0.0
        reckoning = TrackEstimate()
        for _ in range(5):
            at += 5500.0
            error += scale * 5500.0 + rng.normal(0.0, math.sqrt(0.03 * 5500.0))
            reckoning = reckoning.moved(at).updated(error + rng.normal(0.0, 20.0), LANDMARK_MM2)
        off.append((reckoning.error_mm - error) / reckoning.sigma_mm)
    assert abs(np.mean(off)) < 0.2
    assert 0.8 < np.std(off) < 1.25
