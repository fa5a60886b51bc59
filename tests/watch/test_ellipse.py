"""The ellipse of a pose: semiaxes and direction against numpy, and its probability against draws."""

from __future__ import annotations

import math

import numpy as np
import pytest

from colony.nav.pose.pose import PoseEstimate
from colony.watch.asking import ellipse_of


def estimate(xx: float, xy: float, yy: float) -> PoseEstimate:
    return PoseEstimate(0, 0.0, 0.0, 0.0, xx, xy, 0.0, yy, 0.0, 9.0)


@pytest.mark.parametrize(
    ("xx", "xy", "yy"),
    [(900.0, 0.0, 100.0), (100.0, 0.0, 900.0), (500.0, 300.0, 400.0), (500.0, -499.0, 500.0)],
)
def test_axes_are_the_eigenvectors(xx: float, xy: float, yy: float) -> None:
    ellipse = ellipse_of(estimate(xx, xy, yy))
    values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
    factor = math.sqrt(-2 * math.log(0.05))
    assert (ellipse.minor, ellipse.major) == pytest.approx(tuple(factor * np.sqrt(values)))
    angle = math.radians(ellipse.direction)
    assert abs(vectors[:, 1] @ [math.cos(angle), math.sin(angle)]) == pytest.approx(1.0)
    assert ellipse.sigma_deg == 3.0


def test_the_robot_is_in_it_with_95_percent() -> None:
    covariance = np.array([[500.0, 300.0], [300.0, 400.0]])
    ellipse = ellipse_of(estimate(500.0, 300.0, 400.0))
    drawn = np.random.default_rng(3).multivariate_normal([0.0, 0.0], covariance, 20_000)
    angle = math.radians(ellipse.direction)
    along = drawn @ [math.cos(angle), math.sin(angle)]
    across = drawn @ [-math.sin(angle), math.cos(angle)]
    inside = (along / ellipse.major) ** 2 + (across / ellipse.minor) ** 2 <= 1.0
    assert inside.mean() == pytest.approx(0.95, abs=0.006)


def test_an_invalid_covariance_gives_a_flat_ellipse() -> None:
    assert ellipse_of(estimate(100.0, 200.0, 100.0)).minor == 0.0
    assert ellipse_of(estimate(-1.0, 0.0, -1.0)).major == 0.0
