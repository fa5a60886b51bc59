"""Where robots stand in grids."""

from __future__ import annotations

import math

import numpy as np
import pytest

from colony.nav.maps.grid.model import Grid, GridCell
from colony.nav.maps.grid.places import ReachableRegions, clearance_mm, labeled, nearest_place
from colony.nav.maps.world_map import WorldMap, world_of_grid
from colony.text.diagnostics import DiagnosticError
from tests.nav.maps.grid.small_grids import grid_of

ROOM = "\n".join(["#" * 41, *["#" + "." * 39 + "#"] * 39, "#" * 41])
"""A room of 39 cells to the side."""


def room(**place: float) -> WorldMap:
    return world_of_grid(grid_of(ROOM, **place))


def test_a_robot_starts_where_the_map_begins_if_it_fits() -> None:
    world = room(x_mm=-1000.0, y_mm=-1000.0)
    assert world.start(400.0) == (0.0, 0.0, 270.0)
    assert world.start(400.0, (100.0, -200.0, 30.0)) == (100.0, -200.0, 30.0)


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, 25.0])
def test_or_at_the_nearest_place_with_room(yaw_deg: float) -> None:
    world = room(yaw_deg=yaw_deg, x_mm=200.0)
    assert isinstance(world.source, Grid)
    x, y, heading = world.start(400.0)
    across, up = world.source.to_cells(np.array([x, y])).tolist()
    assert (across, up) == pytest.approx((across, across)) or yaw_deg != 0.0
    assert heading == 270.0
    room_mm = clearance_mm(world.source, world.walls, x, y, 1000.0)
    assert 400.0 <= room_mm <= 400.0 + 2.5 * 50.0


def test_unknown_cells_and_the_border_are_no_place_for_a_robot() -> None:
    half = grid_of("\n".join(["." * 20 + "?" * 20] * 40))
    x, y = nearest_place(half, 300.0) or (0.0, 0.0)
    assert (x, y) == pytest.approx((425.0, 425.0), abs=51.0)
    assert clearance_mm(half, np.empty((0, 4)), 900.0, 1000.0, 500.0) == pytest.approx(100.0)
    assert clearance_mm(half, np.empty((0, 4)), 1500.0, 1000.0, 500.0) == 0.0
    assert clearance_mm(half, np.empty((0, 4)), 300.0, 1000.0, 500.0) == pytest.approx(300.0)
    assert clearance_mm(half, np.empty((0, 4)), -300.0, 1000.0, 500.0) == 0.0
    with pytest.raises(
        ValueError, match="100 mm from a wall or from cells that are unknown; expected at least 300"
    ):
        world_of_grid(half).start(300.0, (900.0, 1000.0, 0.0))


def test_nobody_starts_within_an_obstacle_however_large_it_is() -> None:
    block = grid_of("\n".join(["." * 60 + "#" * 60] * 60), x_mm=-5000.0, y_mm=-1500.0)
    world = world_of_grid(block)
    x, y, _ = world.start(300.0)
    assert block.state_at(x, y) is GridCell.FREE
    with pytest.raises(ValueError, match=r"\(-500, 0\) is in an occupied cell"):
        world.start(300.0, (-500.0, 0.0, 0.0))


def test_there_may_be_no_room() -> None:
    with pytest.raises(ValueError, match="no free place for a robot with a radius of 1100 mm"):
        room().start(1100.0)
    assert nearest_place(grid_of("???"), 10.0) is None


def test_the_nearest_place_is_the_nearest_of_all() -> None:
    draws = np.random.default_rng(5)
    for _ in range(5):
        cells = np.where(draws.random((30, 40)) < 0.02, GridCell.OCCUPIED, GridCell.FREE).astype(np.uint8)
        grid = Grid(name="", image="", cells=cells, cell_mm=100.0, x_mm=-1500.0, y_mm=-2000.0, yaw_deg=40.0)
        reach = 2.0 + math.sqrt(0.5) + 1.0
        blocked = np.argwhere(np.pad(cells, 9, constant_values=GridCell.OCCUPIED) == GridCell.OCCUPIED) - 9
        free = [c for c in np.argwhere(cells == GridCell.FREE) if np.hypot(*(blocked - c).T).min() > reach]
        places = grid.to_world(np.array([[column + 0.5, row + 0.5] for row, column in free]).reshape(-1, 2))
        found = nearest_place(grid, 200.0)
        if len(places):
            assert math.hypot(*found) == pytest.approx(np.hypot(*places.T).min())
        else:
            assert found is None


def hall_and_patch(patch: int, wall: str = "#") -> WorldMap:
    """Return a patch whose corner is at (0, 0), and a hall of 60 by 60 cells beside it."""
    rows = [f"{'.' * patch if row < patch else '?' * patch}{wall}{'.' * 60}" for row in range(60)]
    return world_of_grid(grid_of("\n".join(rows[::-1])))


@pytest.mark.parametrize(
    ("patch", "wall", "in_hall"),
    [
        (18, "#", True),  # 9 % of the free cells
        (18, "?", True),
        (18, ".", False),  # a way out
        (22, "#", False),  # 12 %: no stray patch
    ],
)
def test_a_robot_does_not_start_in_a_stray_patch(patch: int, wall: str, in_hall: bool) -> None:
    world = hall_and_patch(patch, wall)
    start = world.start(300.0)
    assert (start.x_mm > 50.0 * (patch + 1)) == in_hall
    assert world.remarks(300.0, start) == ()


def test_a_start_in_a_stray_patch_is_remarked() -> None:
    world = hall_and_patch(18)
    start = world.start(300.0, (450.0, 450.0, 0.0))
    assert start[:2] == (450.0, 450.0)
    [remark] = world.remarks(300.0, start)
    assert remark == (
        "a robot with a radius of 300 mm can get from (0.45 m, 0.45 m) to 6.8 % of the free cells; "
        "--start X,Y,HEADING names another place"
    )
    assert world.reachable(300.0, world.start(300.0)) == pytest.approx(0.91, abs=0.01)


def test_a_place_beside_the_cells_that_fit_is_of_their_region() -> None:
    reach = ReachableRegions(grid_of("\n".join(["#" * 9, *["#" + "." * 7 + "#"] * 7, "#" * 9])), 150.0)
    assert reach.largest == 1
    assert reach.cells(1).sum() == 1
    assert [reach.region(x, 225.0) for x in (225.0, 200.0, 249.0, 150.0, -1e9)] == [1, 1, 1, 0, 0]


def test_regions_are_those_of_a_flood_fill() -> None:
    draws = np.random.default_rng(2)
    for share in (0.0, 0.3, 0.6, 0.7, 1.0):
        mask = draws.random((31, 43)) < share
        regions, filled = labeled(mask), np.zeros(mask.shape, dtype=int)
        assert ((regions > 0) == mask).all()
        for number, seed in enumerate(np.argwhere(mask).tolist(), 1):
            waiting = [tuple(seed)] if not filled[tuple(seed)] else []
            while waiting:
                row, column = waiting.pop()
                if 0 <= row < 31 and 0 <= column < 43 and mask[row, column] and not filled[row, column]:
                    filled[row, column] = number
                    waiting += [(row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)]
        pairs = set(zip(regions.ravel().tolist(), filled.ravel().tolist(), strict=True))
        assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


def test_a_grid_is_no_building() -> None:
    with pytest.raises(DiagnosticError, match=r"M037.*: a camera requires a building"):
        room().building("a camera")
