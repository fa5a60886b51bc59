"""Intervals of proportions and means."""

from __future__ import annotations

import math

import pytest

from colony.experiment.report import Mean, Proportion, Z, mean_of, wilson


@pytest.mark.parametrize(
    ("cases", "total", "low", "high"),
    [
        (0, 10, 0.0, 0.2775),
        (1, 10, 0.0179, 0.4042),
        (10, 10, 0.7225, 1.0),
        (50, 1000, 0.0381, 0.0653),
    ],
)
def test_wilson_interval_of_known_cases_agrees(cases: int, total: int, low: float, high: float) -> None:
    found = wilson(cases, total)
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-4)


@pytest.mark.parametrize("cases", range(21))
def test_wilson_ends_solve_the_score_equation(cases: int) -> None:
    found = wilson(cases, 20)
    for end in (found.low, found.high):
        if 0.0 < end < 1.0:
            score = abs(found.share - end) / math.sqrt(end * (1.0 - end) / 20)
            assert score == pytest.approx(Z)


def test_wilson_of_nothing_knows_nothing() -> None:
    assert wilson(0, 0) == Proportion(0, 0, 0.0, 1.0)


def test_mean_interval_of_equal_values_is_a_point() -> None:
    assert mean_of([2.0] * 7) == Mean(2.0, 2.0, 2.0, 2.0, 2.0)


def test_mean_interval_is_near_the_normal_one_and_repeats() -> None:
    values = [math.sin(n) for n in range(400)]
    found, half = mean_of(values), Z * math.sqrt(0.5 / 400)
    assert found == mean_of(values)
    assert found.mean == pytest.approx(sum(values) / 400)
    assert (found.high - found.mean, found.mean - found.low) == pytest.approx((half, half), rel=0.1)
