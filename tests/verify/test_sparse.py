"""Arrays are written as one value and the runs that differ, by angle where angles name them."""

from __future__ import annotations

import pytest

from colony.ir.bearings import Bearings, between, listed_bearings, uniform
from colony.ir.types import DISTANCE, Array, ScalarValue
from colony.verify.snapshot import run_angles, sparse, sparse_text

RING = uniform(-180.0, None, 360)
CLOCKWISE = uniform(90.0, -1.0, 181)
DENSE = uniform(0.0, 0.0001, 40)


def written(bearings: Bearings | None, values: list[float]) -> str | None:
    array = tuple[ScalarValue, ...](values)
    return sparse_text(array, Array(DISTANCE, len(values), bearings), lambda x: f"{x:g} m")


def with_run(size: int, *runs: tuple[int, int, float]) -> list[float]:
    values = [5.0] * size
    for first, last, value in runs:
        for i in range(first, last + 1):
            values[i] = value
    return values


def test_runs_are_named_by_angle() -> None:
    assert written(RING, with_run(360, (150, 210, 0.4), (300, 300, 1.0))) == (
        "all 5 m, [-30 deg .. 30 deg] 0.4 m, [120 deg] 1 m"
    )


def test_adjacent_runs_have_one_value_each() -> None:
    assert written(RING, with_run(360, (180, 184, 0.4), (185, 190, 0.3))) == (
        "all 5 m, [0 deg .. 4 deg] 0.4 m, [5 deg .. 10 deg] 0.3 m"
    )


def test_a_run_through_the_rear_is_one() -> None:
    assert (
        written(RING, with_run(360, (0, 10, 0.4), (350, 359, 0.4))) == "all 5 m, [170 deg .. -170 deg] 0.4 m"
    )
    assert (
        written(None, with_run(360, (0, 10, 0.4), (350, 359, 0.4)))
        == "all 5 m, [0..10] 0.4 m, [350..359] 0.4 m"
    )


def test_clockwise_elements_are_named_counterclockwise() -> None:
    assert written(CLOCKWISE, with_run(181, (80, 100, 0.4))) == "all 5 m, [-10 deg .. 10 deg] 0.4 m"


@pytest.mark.parametrize("bearings", [None, DENSE, listed_bearings([9.0 * (i * 7 % 40) for i in range(40)])])
def test_what_angles_do_not_name_is_named_by_index(bearings: Bearings | None) -> None:
    assert written(bearings, with_run(40, (3, 7, 0.4))) == "all 5 m, [3..7] 0.4 m"


def test_many_runs() -> None:
    short, long = [float(i % 12) for i in range(24)], [float(i // 2) for i in range(360)]
    assert written(None, short) is None
    shown = written(RING, long)
    assert shown.startswith("all 0 m, [-178 deg .. -177 deg] 1 m, ")
    assert shown.endswith(", and 155 more ranges")
    assert sparse(tuple(long), RING) is None


def test_the_angles_of_a_run_select_exactly_its_elements() -> None:
    for bearings in (RING, CLOCKWISE):
        size = len(bearings.angles)
        for first, last in ((0, 5), (17, 17 + size // 2), (size - 4, size - 1)):
            found = sparse(tuple(with_run(size, (first, last, 0.4))), bearings)
            [run] = found.differing
            angles = run_angles(bearings, run)
            assert angles is not None
            expected = [i for i in range(size) if (found.common == 5.0) == (first <= i <= last)]
            assert sorted(between(bearings, float(angles[0]), float(angles[1]))) == expected
