"""The geometry of polar pictures, without pixels."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from colony.ir.bearings import Bearings, listed_bearings, uniform
from colony.view.polar import (
    MAX_RINGS,
    RadialPlace,
    Sector,
    blind_sector,
    label_bearing,
    layers,
    outline,
    point,
    scale_of,
    sectors,
)


def ring(start: float, step: float | None, size: int) -> Bearings:
    found = uniform(start, step, size)
    assert found is not None
    return found


@pytest.mark.parametrize(("bearing", "x", "y"), [(0, 0, 2), (90, -2, 0), (-90, 2, 0), (180, 0, -2)])
def test_ahead_is_up_and_angles_grow_counterclockwise(bearing: float, x: float, y: float) -> None:
    assert point(bearing, 2.0) == pytest.approx((x, y), abs=1e-12)


@pytest.mark.parametrize(
    ("bearings", "widest", "expected"),
    [
        (ring(-180, 90, 4), 360, [(-225, -135), (-135, -45), (-45, 45), (45, 135)]),
        (ring(-180, 90, 4), 20, [(-190, -170), (-100, -80), (-10, 10), (80, 100)]),
        (ring(10, -10, 2), 360, [(5, 15), (-5, 5)]),
        (ring(0, None, 1), 360, [(-180, 180)]),
        (listed_bearings([0, 90, 100, 90]), 360, [(-15, 15), (75, 95), (95, 115), (75, 95)]),
        (listed_bearings([7]), 360, [(-8, 22)]),
    ],
)
def test_each_element_has_a_sector(
    bearings: Bearings, widest: float, expected: list[tuple[float, float]]
) -> None:
    assert list(sectors(bearings, widest)) == expected


@pytest.mark.parametrize(
    ("bearings", "expected"),
    [
        (ring(-180, 15, 24), None),
        (ring(-135, 0.5, 541), (135.25, 224.75)),
        (ring(20, -10, 5), (25, 335)),
        (ring(-90, 60, 4), (120, 240)),
        (listed_bearings([-45, 0, 45]), (75, 285)),
        (listed_bearings([0, 50, 100, 150, -160, -110, -60]), None),
    ],
)
def test_only_arcs_and_lists_with_a_gap_are_blind_somewhere(
    bearings: Bearings, expected: tuple[float, float] | None
) -> None:
    assert blind_sector(bearings) == expected


def test_elements_along_one_bearing_lie_in_layers() -> None:
    assert layers(listed_bearings([0, 90, 0])) == (RadialPlace(0, 2), RadialPlace(0, 1), RadialPlace(1, 2))


def test_a_sector_with_a_hole_has_no_tip() -> None:
    wedge, slab = outline(Sector(0, 90), 0.0, 1.0), outline(Sector(0, 90), 0.5, 1.0)
    assert wedge[0] == (0, 0)
    assert {round(math.hypot(*p), 9) for p in slab} == {0.5, 1.0}
    assert len(wedge) == 32
    assert len(outline(Sector(0, 0.1), 0.0, 1.0)) == 3


@pytest.mark.parametrize(
    ("values", "low", "rings"),
    [
        ([0.4, 3.2], 0, (1, 2, 3, 4)),
        ([0.27], 0, (0.1, 0.2, 0.3)),
        ([10], 0, (2, 4, 6, 8, 10)),
        ([-20, 30], -20, (-10, 0, 10, 20, 30)),
        ([-3], -3, (-2, -1, 0)),
        ([1, math.inf, math.nan], 0, (0.2, 0.4, 0.6, 0.8, 1)),
        ([], 0, (1, 2, 3, 4, 5)),
        ([0, 0], 0, (1, 2, 3, 4, 5)),
        ([5e-324], 0, (1, 2, 3, 4, 5)),
    ],
)
def test_rings_are_round_numbers(values: list[float], low: float, rings: tuple[float, ...]) -> None:
    scale = scale_of(values, otherwise=5.0)
    assert (scale.low, scale.rings, scale.high) == (low, rings, rings[-1])


@pytest.mark.parametrize("low", [0.0, -1e-280, -0.3, -7.0, -99.0, -1e12, -1.7976931348623157e308])
@pytest.mark.parametrize("high", [0.0, 1e-280, 0.9, 12.0, 101.0, 1e300, 1.7976931348623157e308])
def test_every_value_has_a_radius(low: float, high: float) -> None:
    scale = scale_of([low, high])
    assert 1 <= len(scale.rings) <= MAX_RINGS
    assert all(a < b for a, b in pairwise((scale.low, *scale.rings)))
    assert all(map(math.isfinite, (scale.low, *scale.rings)))
    assert 0.0 <= scale.radius(low) <= scale.radius(high) <= 1.0
    assert (scale.radius(scale.low), scale.radius(scale.high)) == (0.0, 1.0)


def test_labels_stand_in_the_blind_sector_or_beside_few_points() -> None:
    assert label_bearing([], Sector(135, 225)) == 180
    crowded = [(float(b), 0.5) for b in range(-180, 180, 5) if not 10 < b < 35]
    assert label_bearing(crowded, None) == 22.5
    assert label_bearing(crowded, Sector(0, 5)) == 22.5
