"""Legs in the modes of the Navigator: which lights are tracked, how far a corner leads."""

from __future__ import annotations

import pytest

from colony.nav.maps.corridors import END_CLEARANCE_MM, Corridor
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.plan.plan import LEAVE_MM, LIGHT_AHEAD_MM, DisconnectedCorridors, Leg, legs_of, segments_of


def corridor(start: tuple[float, float], end: tuple[float, float], width: float = 2000.0) -> Corridor:
    heading = 0.0 if start[0] == end[0] else 90.0
    return Corridor(start=Point(*start), end=Point(*end), heading_deg=heading, width_mm=width, edges=())


SOUTH = corridor((20_000.0, 0.0), (-1_000.0, 0.0))
WEST = corridor((0.0, -1_000.0), (0.0, 20_000.0), width=3000.0)
JOG = corridor((1_500.0, 18_500.0), (-4_500.0, 18_500.0), width=3000.0)
BEYOND = corridor((-3_000.0, 17_000.0), (-3_000.0, 40_000.0), width=3000.0)


def modes(corridors: tuple[Corridor, ...], origin: Point, goal: Point, *lights: Point) -> tuple[str, str]:
    legs = legs_of(corridors, origin, goal)
    assert not isinstance(legs, DisconnectedCorridors)
    segments, letters = segments_of(legs, lights, "f")
    return "".join(chr(s.kind) + f"{s.length_mm:.0f} " for s in segments), letters


def test_one_leg_without_lights() -> None:
    assert modes((SOUTH,), Point(2000.0, 900.0), Point(9000.0, -900.0)) == ("D7000 ", "d")


def test_lights_end_where_the_last_one_is() -> None:
    lights = [Point(x, 0.0) for x in (9000.0, 3000.0, 6000.0)]
    assert modes((SOUTH,), Point(2000.0, 0.0), Point(11_000.0, 0.0), *lights) == ("L7000 D2000 ", "ld")
    (track, _), _ = segments_of(_legs(), tuple(lights), "f")
    assert track.lights_mm == pytest.approx((1000.0, 4000.0, 7000.0))
    assert track.heading_deg == 270.0


def _legs() -> tuple[Leg, ...]:
    legs = legs_of((SOUTH,), Point(2000.0, 0.0), Point(11_000.0, 0.0))
    assert not isinstance(legs, DisconnectedCorridors)
    return legs


@pytest.mark.parametrize(
    ("x", "tracked"),
    [
        (2590.0, False),
        (2610.0, True),
        (10_490.0, True),
        (10_510.0, False),
        (1000.0, False),
        (12_000.0, False),
    ],
)
def test_lights_at_either_end_of_a_leg_are_not_tracked(x: float, tracked: bool) -> None:
    _, letters = modes((SOUTH,), Point(2000.0, 0.0), Point(11_000.0, 0.0), Point(x, 0.0))
    assert letters == ("ld" if tracked else "d")


def test_lights_of_other_corridors_are_not_tracked() -> None:
    assert modes((SOUTH,), Point(2000.0, 0.0), Point(9000.0, 0.0), Point(5000.0, 1100.0))[1] == "d"


def test_a_corner_leads_out_of_its_turning_space() -> None:
    # SOUTH is 2 m wide: 1 m to its wall, and half a meter more.
    text, letters = modes((SOUTH, WEST), Point(9000.0, 0.0), Point(0.0, 9000.0))
    assert (text, letters) == (f"E9000 C{1000 + LEAVE_MM:.0f} D7500 ", "cd")
    # WEST is 3 m wide, and the goal 2 m from its middle: half of the way.
    assert modes((WEST, SOUTH), Point(0.0, 9000.0), Point(2000.0, 0.0)) == ("E9000 C1000 D1000 ", "cd")


def test_a_corner_leads_to_half_of_a_jog_at_most() -> None:
    text, letters = modes((WEST, JOG, BEYOND), Point(0.0, 0.0), Point(-3000.0, 30_000.0))
    assert (text, letters) == ("E18500 C1500 E1500 C2000 D9500 ", "ccd")


def test_a_corner_ends_early_enough_for_the_first_light() -> None:
    goal = Point(0.0, 9000.0)
    near = Point(0.0, 1000.0 + LIGHT_AHEAD_MM + 100.0)
    assert modes((SOUTH, WEST), Point(9000.0, 0.0), goal, near) == ("E9000 C1100 L600 D7300 ", "cld")
    too_near = Point(0.0, 1000.0 + LIGHT_AHEAD_MM - 100.0)
    assert modes((SOUTH, WEST), Point(9000.0, 0.0), goal, too_near)[1] == "cd"


def test_lights_of_turning_spaces_at_the_ends_of_a_leg_are_not_tracked() -> None:
    middle, within = Point(0.0, 0.0), Point(1400.0, 0.0)
    assert modes((SOUTH, WEST), Point(9000.0, 0.0), Point(0.0, 9000.0), middle, within)[1] == "cd"
    assert modes((SOUTH, WEST), Point(9000.0, 0.0), Point(0.0, 9000.0), Point(1600.0, 0.0))[1] == "lcd"


def test_who_stands_in_the_turning_space_goes_back_to_its_middle() -> None:
    """On an outer wall a jamb may lie beyond the middle of the space in which the path turns."""
    text, letters = modes((SOUTH, WEST), Point(-300.0, -900.0), Point(0.0, 9000.0))
    assert (text, letters) == ("E300 C1500 D7500 ", "cd")
    legs = legs_of((SOUTH, WEST), Point(-300.0, 0.0), Point(0.0, 9000.0))
    assert not isinstance(legs, DisconnectedCorridors)
    assert legs[0].heading_deg == 270.0


def test_nobody_stands_in_the_wall_with_which_a_corridor_ends() -> None:
    """Where a way begins or ends at a corner of the walls."""
    assert (
        modes((SOUTH,), SOUTH.end, Point(9000.0, 0.0))[0] == f"D{9000 - SOUTH.end.x - END_CLEARANCE_MM:.0f} "
    )
    assert modes((WEST,), Point(0.0, 9000.0), WEST.end)[0] == f"D{WEST.end.y - END_CLEARANCE_MM - 9000:.0f} "
    nook = corridor((0.0, 0.0), (800.0, 0.0), width=1200.0)
    assert modes((nook,), nook.start, nook.end)[0] == "D0 "


def test_a_dead_end_that_a_ring_leads_into_is_left_out() -> None:
    assert modes((SOUTH, WEST, SOUTH), Point(9000.0, 0.0), Point(3000.0, 0.0)) == ("D6000 ", "d")


def test_corridors_that_do_not_meet() -> None:
    assert legs_of((SOUTH, BEYOND), Point(9000.0, 0.0), Point(-3000.0, 30_000.0)) == DisconnectedCorridors(
        SOUTH, BEYOND
    )
