from __future__ import annotations

import math

import numpy as np
import pytest

from colony.nav.mapping.local_map import WallLine
from colony.nav.mapping.wall_matching import (
    WallCandidate,
    WallMatch,
    combine_matches,
    in_building_frame,
    match_wall,
)
from colony.nav.maps.stickrep.model import EdgeKind, Pose
from colony.nav.maps.walls import Walls
from colony.nav.pose.echoes import Reflectors, reflectors_of

NORTH = Pose(0.0, 0.0, 0.0)
"""In the middle of a hallway 2.4 m wide that leads north, and ends 6 m ahead."""


def hallway(attributes: tuple[str, ...] = ("brick", "brick", "wood", "brick")) -> Reflectors:
    """The west wall, whole; the end; the east wall with a door in it."""
    segments = [
        (-1_200, -6_000, -1_200, 6_000),
        (-1_200, 6_000, 1_200, 6_000),
        (1_200, 500, 1_200, -500),
        (1_200, 6_000, 1_200, 500),
        (1_200, -500, 1_200, -6_000),
    ]
    kinds = (EdgeKind.WALL, EdgeKind.WALL, EdgeKind.DOOR, EdgeKind.WALL, EdgeKind.WALL)
    return reflectors_of(
        Walls(segments=np.array(segments, dtype=float), kinds=kinds, attributes=(*attributes, "brick"))
    )


def line(angle_deg: float, distance_mm: float, begin: float = -1_500.0, end: float = 1_500.0) -> WallLine:
    return WallLine(angle_deg, distance_mm, 300.0, begin, end, 30.0)


def match(seen: WallLine, walls: Reflectors | None = None) -> WallMatch | None:
    return match_wall(in_building_frame(seen, NORTH), hallway() if walls is None else walls, NORTH)


def test_a_line_in_the_building() -> None:
    west = Pose(1_000.0, 2_000.0, 90.0)
    x0, y0, x1, y1, *_ = in_building_frame(line(0.0, 500.0, -100.0, 900.0), west)
    assert (x0, y0) == pytest.approx((1_100.0, 1_500.0))  # facing west, 500 to the left is south
    assert (x1, y1) == pytest.approx((100.0, 1_500.0))


def test_a_wall_on_the_left_and_in_pieces_on_the_right() -> None:
    left, right = match(line(0.0, 1_150.0)), match(line(0.0, -1_230.0))
    assert (left.turn_deg, left.shift_mm) == pytest.approx((0.0, -50.0))
    assert (left.normal_x, left.normal_y) == pytest.approx((1.0, 0.0))
    assert right.shift_mm == pytest.approx(30.0)
    assert (right.normal_x, right.normal_y) == pytest.approx((-1.0, 0.0))


@pytest.mark.parametrize("error", [-12.0, -3.0, 5.0, 14.0])
def test_a_heading_that_is_off(error: float) -> None:
    """The robot looks to the left by `error`, and does not know: the walls seem to be turned to the right."""
    turned = match(line(-error, 1_200.0))
    assert turned.turn_deg == pytest.approx(error)
    assert turned.shift_mm == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("leaf", [30.0, 60.0, 75.0, -60.0])
def test_the_leaf_of_an_open_door_is_no_wall(leaf: float) -> None:
    assert match(line(leaf, -1_300.0, -400.0, 500.0)) is None


def test_the_back_wall_of_a_room_is_no_wall() -> None:
    assert match(line(0.0, -4_200.0, -500.0, 500.0)) is None


def test_what_is_on_the_other_side_of_the_robot_is_no_wall() -> None:
    narrow = Reflectors(*(field[:1] for field in hallway()))
    near = Pose(-1_150.0, 0.0, 0.0)
    assert match_wall(WallCandidate(-1_100.0, -900.0, -1_100.0, 900.0, 300.0, 30.0), narrow, near) is None


def test_a_line_beyond_the_end_of_a_wall_is_no_wall() -> None:
    assert match(line(0.0, 1_200.0, 5_500.0, 8_000.0)) is None


def test_glass_is_no_wall() -> None:
    assert match(line(0.0, 1_200.0), hallway(("glass", "brick", "wood", "brick"))) is None


def test_no_walls_and_no_length() -> None:
    assert match(line(0.0, 1_200.0), Reflectors(*(field[:0] for field in hallway()))) is None
    assert match_wall(WallCandidate(1.0, 1.0, 1.0, 1.0, 1.0, 1.0), hallway(), NORTH) is None


def test_side_walls_leave_the_place_along_the_hallway() -> None:
    sides = tuple(m for m in (match(line(-4.0, 1_150.0)), match(line(-4.0, -1_230.0))) if m is not None)
    fix = combine_matches(sides)
    assert fix.heading_deg == pytest.approx(4.0)
    assert (fix.x_mm, fix.y_mm) == pytest.approx((-40.0, 0.0), abs=0.5)
    assert fix.heading_sd_deg < sides[0].turn_sd_deg


def test_a_wall_ahead_gives_it() -> None:
    """The end of the hallway seems to be 200 mm nearer than it is drawn."""
    ahead = match(line(-90.0, -5_800.0, -1_000.0, 1_000.0)) or match(line(-90.0, 5_800.0, -1_000.0, 1_000.0))
    assert ahead is not None
    fix = combine_matches(tuple(m for m in (match(line(0.0, 1_200.0)), ahead) if m is not None))
    assert (fix.x_mm, fix.y_mm) == pytest.approx((0.0, 200.0), abs=1e-6)


def test_a_line_that_contradicts_the_surest_one_is_left_out() -> None:
    sure = WallMatch(2.0, 10.0, 1.0, 0.0, 0.2, 10.0)
    other = WallMatch(-9.0, 300.0, -1.0, 0.0, 2.0, 10.0)
    assert combine_matches((other, sure)) == combine_matches((sure,))
    assert combine_matches(()) is None
    assert not math.isnan(combine_matches((sure,)).x_mm)  # type: ignore[union-attr]
