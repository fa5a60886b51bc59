from __future__ import annotations

import numpy as np

from colony.nav.maps.stickrep.checks import crossing_pairs


def pairs(*segments: tuple[float, float, float, float]) -> list[tuple[int, int]]:
    array = np.array(segments)
    return crossing_pairs(array[:, :2], array[:, 2:])


def test_crossings_are_found_once_for_the_later_edge() -> None:
    assert pairs((0, 0, 10, 0), (5, -5, 5, 5)) == [(0, 1)]
    assert pairs((0, 0, 10, 0), (0, 1, 10, 1), (5, -5, 5, 5)) == [(0, 2)]


def test_touching_and_parallel_edges_do_not_cross() -> None:
    assert pairs((0, 0, 10, 0), (10, 0, 10, 10)) == []
    assert pairs((0, 0, 10, 0), (5, 0, 5, 10)) == []
    assert pairs((0, 0, 10, 0), (0, 1, 10, 1)) == []
    assert pairs((0, 0, 10, 0), (0, 0, 10, 0)) == []


def test_blocks_of_many_edges_are_compared_with_each_other() -> None:
    rows = [(0.0, 10.0 * i, 5.0, 10.0 * i) for i in range(600)]
    assert pairs(*rows, (1.0, 5.0, 1.0, 15.0)) == [(1, 600)]
