"""Growth within a life and from life to life of processes that are killed: what counts and what does not."""

from __future__ import annotations

import os

from colony.cli.robot.acceptance.findings import Census, Incarnations

MB = 1 << 20


def lives(*curves: list[int]) -> Incarnations:
    made = Incarnations()
    made.curves = [[size * MB for size in curve] for curve in curves]
    return made


def grown(*curves: list[int]) -> list[int]:
    return [size // MB for _, size in lives(*curves).lives]


def test_only_what_comes_after_the_start_and_the_warm_up_is_growth() -> None:
    assert grown([*range(0, 40, 2), *[41] * 40]) == [0]
    assert grown([40] * 20 + [44] * 20, [40] * 60) == [4, 0]
    assert grown([5, 40, 41]) == [0]


def test_a_steady_leak_is_seen_from_the_warm_up_on() -> None:
    assert grown([40 + second for second in range(100)])[0] > 20


def test_lives_that_begin_larger_and_larger_drift() -> None:
    assert lives(*([size] * 20 for size in (40, 40, 41, 42, 50, 50))).drift == 10 * MB
    assert lives(*([size] * 20 for size in (40, 50, 40, 50, 40, 50))).drift == 0
    assert lives([40] * 20, [90] * 20).drift == 0


def test_a_new_process_id_begins_a_new_curve() -> None:
    census = Census()
    for _ in range(2):
        census.take({"me": os.getpid()})
    census.take({"me": os.getppid()})
    assert [len(curve) for curve in census.processes["me"].curves] == [2, 1]


def test_growth_and_drift_beyond_what_deaths_explain_are_problems() -> None:
    census = Census()
    census.processes = {
        "leaks": lives([50] * 20 + [60] * 20),
        "drifts": lives(*([size] * 20 for size in (40, 40, 41, 42, 50, 50))),
        "steady": lives([40] * 60),
    }
    assert census.largest == 60 * MB
    assert list(census.problems(deaths_per_s=0.5)) == [
        "leaks grew by 10.0 MB in a life of 40 s",
        "drifts became larger by 10.0 MB over its restarts",
    ]
    assert not any("leaks" in text for text in census.problems(deaths_per_s=20.0))
