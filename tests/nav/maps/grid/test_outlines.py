"""The walls around occupied cells: closed, oriented, without gaps, and nowhere far from the cells."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import colony.nav.maps.grid.outlines as module
from colony.nav.maps.grid.outlines import TOLERANCE, TooManySidesError, outlines
from tests.nav.maps.grid.office import OCCUPIED, drawn_office

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]


def occupied(drawing: str) -> Bools:
    return np.array([[letter == "#" for letter in line] for line in drawing.split()][::-1])


def middles(cells: Bools) -> Floats:
    """The middles of all sides between occupied and other cells, (n, 2), one by one."""
    found = []
    padded = np.pad(cells, 1)
    for row, column in np.argwhere(padded):
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            if not padded[row + dy, column + dx]:
                found.append((column - 0.5 + dx / 2.0, row - 0.5 + dy / 2.0))
    return np.array(found).reshape(-1, 2)


def distances(points: Floats, walls: Floats) -> Floats:
    """The distance of each point to the nearest wall."""
    begin, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    start = points[:, None] - begin
    fraction = np.clip((start * along).sum(axis=2) / (along * along).sum(axis=1), 0.0, 1.0)
    nearest: Floats = np.hypot(*np.moveaxis(start - fraction[..., None] * along, 2, 0)).min(axis=1)
    return nearest


def windings(points: Floats, walls: Floats) -> NDArray[np.int64]:
    """How many times the walls go around each point, counterclockwise."""
    x, y = points[:, 0, None], points[:, 1, None]
    x0, y0, x1, y1 = walls.T
    side = (x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)
    up, down = (y0 <= y) & (y < y1) & (side > 0), (y1 <= y) & (y < y0) & (side < 0)
    total: NDArray[np.int64] = up.sum(axis=1) - down.sum(axis=1)
    return total


def assert_sound(cells: Bools) -> Floats:
    """Hold the walls of some cells to all that is promised of them."""
    walls = outlines(cells)
    begins, ends = walls[:, :2].tolist(), walls[:, 2:].tolist()
    assert sorted(begins) == sorted(ends)  # closed
    first = 0
    for wall in range(len(walls)):
        if ends[wall] == begins[first]:
            first = wall + 1
        else:
            assert ends[wall] == begins[wall + 1]
    assert first == len(walls)
    assert (begins != ends) or not begins
    sides = middles(cells)
    if len(sides):
        assert distances(sides, walls).max() <= TOLERANCE + 1e-6
    return walls


@pytest.mark.parametrize(
    ("drawing", "walls"),
    [
        ("...", []),
        ("#", [[0, 0, 1, 0], [1, 0, 1, 1], [1, 1, 0, 1], [0, 1, 0, 0]]),
        ("##", [[0, 0, 2, 0], [2, 0, 2, 1], [2, 1, 0, 1], [0, 1, 0, 0]]),
        (
            "### #.# ###",
            [
                [[0, 0, 3, 0], [3, 0, 3, 3], [3, 3, 0, 3], [0, 3, 0, 0]],
                [[1, 2, 2, 2], [2, 2, 2, 1], [2, 1, 1, 1], [1, 1, 1, 2]],
            ],
        ),
    ],
)
def test_straight_runs_are_one_wall_with_the_occupied_cells_on_the_left(
    drawing: str, walls: list[object]
) -> None:
    assert assert_sound(occupied(drawing)).tolist() == np.array(walls, dtype=float).reshape(-1, 4).tolist()


def test_cells_that_touch_at_a_corner_leave_no_gap() -> None:
    for cells in (np.eye(40, dtype=np.bool_), np.eye(40, dtype=np.bool_)[::-1]):
        walls = assert_sound(cells)
        assert len(walls) == 2  # there, and back
        across = np.array([[float(k), 40.0 - k] for k in np.arange(0.5, 40.0, 0.37)])
        assert distances(np.array([[20.0, 20.0]]), walls)[0] <= TOLERANCE
        assert len(across)


@pytest.mark.parametrize("slope", [0.0, 0.03, 0.1, 0.25, 1 / 3, 0.5, 0.7, 0.9, 1.0])
def test_a_slanted_wall_is_no_staircase(slope: float) -> None:
    y, x = np.mgrid[:300, :300]
    walls = assert_sound(np.abs(y - 20.0 - slope * x) < 3.0)
    assert len(walls) <= 100  # of about 900 sides of cells


def test_a_circle_has_few_walls() -> None:
    y, x = np.mgrid[:200, :200]
    assert len(assert_sound(np.hypot(x - 100, y - 100) < 80)) < 70


def test_corners_of_rooms_stay_right_angles() -> None:
    walls = outlines(np.pad(np.zeros((40, 60), dtype=np.bool_), 2, constant_values=True))
    assert sorted(walls[4:].tolist()) == [[2, 2, 2, 42], [2, 42, 62, 42], [62, 2, 2, 2], [62, 42, 62, 2]]


@pytest.mark.parametrize("density", [0.02, 0.2, 0.5, 0.8])
def test_any_cells(density: float) -> None:
    for seed in range(30):
        cells = np.random.default_rng(seed).random((13, 17)) < density
        assert_sound(cells)


def test_walls_go_around_what_is_occupied_and_nothing_else() -> None:
    """Centers that are farther than a cell from all sides are inside of the walls if they are occupied."""
    cells = drawn_office(200, 200, seed=3) == OCCUPIED
    cells[20:60, 20:60] = True
    walls = assert_sound(cells)
    rows, columns = np.mgrid[:200:3, :200:3]
    centers = np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5], axis=-1)
    is_clear = distances(centers, walls) > 1.0
    found = windings(centers[is_clear], walls)
    assert found.tolist() == cells[rows.ravel(), columns.ravel()][is_clear].astype(int).tolist()
    assert 0 < found.sum() < len(found)


def test_an_office_has_few_walls() -> None:
    cells = drawn_office(400, 400, seed=1) == OCCUPIED
    assert len(outlines(cells)) < len(middles(cells)) / 8


def test_too_many_sides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_SIDES", 15)
    assert len(outlines(occupied("#.#.#"))) == 12
    with pytest.raises(TooManySidesError, match="more than 15 sides"):
        outlines(occupied("#.#.#.#"))
