"""The path of a robot over days: bounded, with both of its ends, and true to the shape."""

from __future__ import annotations

import math

from colony.robots.driven_path import SPACING_MM, DrivenPath


def test_a_short_path_has_its_first_and_its_newest_place() -> None:
    path = DrivenPath()
    for x in range(1000):
        path.add(float(x), 0.0)
    assert path.points[0] == (0.0, 0.0)
    assert path.points[-1] == (999.0, 0.0)
    assert all(math.dist(a, b) <= 2 * SPACING_MM for a, b in zip(path.points, path.points[1:], strict=False))


def test_a_robot_that_stands_adds_nothing() -> None:
    path = DrivenPath()
    for _ in range(1000):
        path.add(5.0, 5.0)
    assert path.points == [(5.0, 5.0), (5.0, 5.0)]


def test_a_long_path_stays_bounded_and_evenly_spaced() -> None:
    path = DrivenPath(max_points=100)
    for step in range(200_000):
        path.add(7.0 * step, 0.0)
        assert len(path.points) <= 100
    assert path.points[0] == (0.0, 0.0)
    assert path.points[-1] == (7.0 * 199_999, 0.0)
    gaps = [b[0] - a[0] for a, b in zip(path.points, path.points[1:], strict=False)]
    assert len(gaps) > 25
    assert max(gaps) < 0.1 * path.points[-1][0]
