"""The published runs: the table agrees with itself and with what the thesis says of it."""

from __future__ import annotations

import math

import pytest

from studies.confidence.published_runs import PUBLISHED_RUNS


def test_forty_runs_five_of_which_failed() -> None:
    assert [(run.wing, run.number) for run in PUBLISHED_RUNS] == [
        *(("old", i) for i in range(1, 28)),
        *(("new", i) for i in range(1, 14)),
    ]
    assert sum(run.reached for run in PUBLISHED_RUNS) == 35
    for run in PUBLISHED_RUNS:
        assert run.reached == (run.seconds is not None) == (run.failed_mode is None)


def test_counts_of_modes_are_those_of_section_6_3() -> None:
    assert sum(run.required[0] for run in PUBLISHED_RUNS) == 101
    assert sum(run.completed[1] for run in PUBLISHED_RUNS) == 79
    failed = [run.failed_mode for run in PUBLISHED_RUNS if run.failed_mode]
    assert (failed.count("l"), failed.count("c")) == (2, 3)
    assert all(run.required[2] == 1 for run in PUBLISHED_RUNS)


def test_speeds_are_those_of_section_6_1() -> None:
    speed = {
        (run.wing, run.number): run.distance_mm / 1000 / (run.seconds / 60)
        for run in PUBLISHED_RUNS
        if run.seconds
    }
    old = [v for (wing, _), v in speed.items() if wing == "old"]
    assert min(old) == pytest.approx(7.0, abs=0.01)
    assert max(old) == speed["old", 26] == pytest.approx(17.875, abs=0.001)
    assert speed["new", 1] == pytest.approx(4.7, abs=0.02)
    assert speed["new", 7] == pytest.approx(10.25, abs=0.01)


def test_no_robot_overshot_by_more_than_a_meter() -> None:
    beyond = [run.beyond_goal_mm for run in PUBLISHED_RUNS if run.beyond_goal_mm is not None]
    assert max(beyond) == 1000.0
    assert min(beyond) == -450.0


def test_distances_are_whole_inches_rounded_down() -> None:
    for run in PUBLISHED_RUNS:
        inches = math.ceil(run.distance_mm / 25.4 - 1e-6)
        assert int(inches * 25.4 + 1e-6) == int(run.distance_mm)


def test_overshoot_was_compensated_from_the_end_of_1993_on() -> None:
    assert [(run.wing, run.number) for run in PUBLISHED_RUNS if run.compensated] == [
        ("old", 27), ("new", 10), ("new", 11), ("new", 12), ("new", 13),
    ]  # fmt: skip
