"""Growth within a life and from life to life of processes that are killed: what counts and what does not."""

from __future__ import annotations

import os

from tools.process_sizes import Census, Incarnations

MB = 1 << 20


def lives(*curves: list[int]) -> Incarnations:
    made = Incarnations()
    made.curves = [[size * MB for size in curve] for curve in curves]
    return made


def test_only_what_comes_after_the_start_and_the_warm_up_is_growth() -> None:
    assert lives([*range(0, 40, 2), *[41] * 40]).growth == 0
    assert lives([40] * 20 + [44] * 20, [40] * 60).growth == 4 * MB
    assert lives([5, 40, 41]).growth == 0


def test_a_steady_leak_is_seen_from_the_warm_up_on() -> None:
    assert lives([40 + second for second in range(100)]).growth > 20 * MB


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
