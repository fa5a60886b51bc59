"""Bearings, held to definitions that turn every angle by whole turns and look at all elements."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from random import Random

import pytest

from colony.ir.bearings import (
    Bearings,
    between,
    index_text,
    listed_bearings,
    lookup,
    naming_angle,
    nearest,
    part_by_bearing,
    part_by_index,
    reaches_beyond,
    sweep,
    uniform,
)
from tests.sampling import sampled

TURNS = [360 * k for k in range(-5, 6)]


def ring(start: float, step: float | None, size: int) -> Bearings:
    found = uniform(start, step, size)
    assert found is not None
    return found


# --- definitions -----------------------------------------------------------------------------------


def distance(bearing: float, angle: float) -> Fraction:
    """The angle between two directions."""
    apart = abs(Fraction(bearing) - Fraction(angle)) % 360
    return min(apart, 360 - apart)


def closest(angles: Sequence[float], angle: float) -> int:
    """The nearest element, of two the lower; the angle is taken to [0, 360) as `mod` does."""
    angle %= 360.0
    return min(range(len(angles)), key=lambda i: (distance(angles[i], angle), i))


def nearest_on_arc(start: float, step: float, size: int, angle: float) -> int | None:
    """What `nearest` says of elements START + i * STEP that do not close."""
    angle %= 360.0
    ends = sorted((start, start + (size - 1) * step))
    is_between = any(ends[0] <= angle + turn <= ends[1] for turn in TURNS)
    if not is_between and min(distance(end, angle) for end in ends) >= abs(step) / 2:
        return None
    return closest([start + i * step for i in range(size)], angle)


def nearest_in_list(angles: Sequence[float], angle: float) -> int | None:
    """What `nearest` says of listed bearings, of which no two gaps above 60 degrees are equal."""
    angle %= 360.0
    order = sorted({angle % 360 for angle in angles})
    gaps = [(b - a, a, b) for a, b in pairwise([*order, order[0] + 360])]
    gap, before, after = max(gaps)
    is_in_gap = any(before < angle + turn < after for turn in TURNS)
    if gap > 60 and is_in_gap and min(distance(x, angle) for x in angles) >= 30:
        return None
    return closest(angles, angle)


def looked_up(bearings: Bearings, angle: float) -> int | None:
    """What executors compute: they count the breaks below an angle in [0, 360]."""
    table, turned = lookup(bearings), angle % 360.0
    return table.indices[sum(b < turned for b in table.breaks)] if math.isfinite(angle) else None


# --- cases -----------------------------------------------------------------------------------------


def angles_for(bearings: Bearings, random: Random) -> Iterator[float]:
    """Angles at, beside and between breaks, several turns away, and nowhere near."""
    for b in lookup(bearings).breaks:
        for x in (b, b - 360, b + 720, -b):
            yield from (x, math.nextafter(x, math.inf), math.nextafter(x, -math.inf))
    yield from (0.0, -0.0, 180.0, -180.0, 359.99999999999994, 5e-324, -5e-324, -1e-20)
    yield from (random.uniform(-1000, 1000) for _ in range(20))
    yield from (random.randrange(-1440, 1440) / 2 for _ in range(40))


ARCS = [(-90.0, 20.0, 8), (135.0, -0.5, 60), (-180.0, 45.0, 7), (10.0, -7.25, 24), (0.0, 350.0, 1)]
ARCS += [(170.0, 15.0, 3), (0.0, 179.5, 2), (-0.5, 0.125, 24), (90.0, -61.0, 5)]


@pytest.mark.parametrize(("start", "step", "size"), ARCS)
def test_nearest_on_an_arc(start: float, step: float, size: int) -> None:
    bearings = ring(start, step, size)
    assert not bearings.closes
    for angle in angles_for(bearings, Random(1)):
        assert nearest(bearings, angle) == nearest_on_arc(start, step, size, angle), angle


@pytest.mark.parametrize("size", [1, 2, 3, 4, 8, 13, 24])
@pytest.mark.parametrize("start", [-180.0, 0.0, 7.5])
def test_nearest_on_a_ring(size: int, start: float) -> None:
    for step in (None, -360 / size):
        bearings = ring(start, step, size)
        assert bearings.closes
        assert bearings.ends is None
        for angle in angles_for(bearings, Random(2)):
            assert nearest(bearings, angle) == closest(bearings.angles, angle), angle


PARTS = sampled(range(10), every=10, thorough=True)
"""Parts of the lists that are compared."""


def lists(part: int) -> Iterator[list[float]]:
    random = Random(3 + part)
    for _ in range(6):
        yield [random.uniform(-400, 400) for _ in range(random.randint(1, 8))]
        yield [float(random.randrange(-180, 360, 30)) for _ in range(random.randint(3, 12))]
        yield [float(random.randrange(-40, 40)) for _ in range(random.randint(2, 24))]


@pytest.mark.parametrize("part", PARTS)
def test_nearest_in_a_list(part: int) -> None:
    several = 0
    for angles in lists(part):
        bearings = listed_bearings(angles)
        order = sorted(set(bearings.angles))
        gaps = sorted(round(b - a, 9) for a, b in pairwise([*order, order[0] + 360]))
        if len(gaps) > 1 and gaps[-1] == gaps[-2] > 60:
            several += 1
            continue  # which gap is outside is another test's
        for angle in angles_for(bearings, Random(4)):
            assert nearest(bearings, angle) == nearest_in_list(bearings.angles, angle), (angles, angle)
    assert several < 9


@pytest.mark.parametrize("part", PARTS)
def test_what_executors_compute_is_the_nearest_in_a_list(part: int) -> None:
    random = Random(5)
    for angles in lists(part):
        whole = listed_bearings(angles)
        some = tuple(random.sample(range(len(angles)), random.randint(1, len(angles))))
        for bearings in (
            whole,
            part_by_index(whole, some),
            part_by_bearing(whole, between(whole, -180.0, 180.0)[1:] or (0,)),
        ):
            for angle in angles_for(bearings, Random(6)):
                assert looked_up(bearings, angle) == nearest(bearings, angle), (bearings, angle)


@pytest.mark.parametrize(
    ("start", "step", "size"), [*ARCS, (-180.0, None, 24), (0.0, None, 7), (0.0, -360 / 7, 7)]
)
def test_what_executors_compute_is_the_nearest(start: float, step: float | None, size: int) -> None:
    bearings = ring(start, step, size)
    for angle in (*angles_for(bearings, Random(7)), 1e300, -1e17, math.inf, math.nan):
        assert looked_up(bearings, angle) == nearest(bearings, angle), (bearings, angle)


def test_of_two_the_lower_index_is_the_nearest() -> None:
    assert nearest(ring(-180.0, None, 4), -135.0) == 0
    assert nearest(ring(-180.0, None, 4), 135.0) == 0  # of 3 and 0
    assert nearest(ring(0.0, -90.0, 4), 45.0) == 0
    assert nearest(listed_bearings([20.0, -20.0, 20.0]), 20.0) == 0
    assert nearest(listed_bearings([20.0, -20.0, 20.0]), 0.0) == 0
    assert nearest(listed_bearings([-20.0, 20.0]), 0.0) == 0


def test_half_a_step_beyond_the_ends_is_outside() -> None:
    bearings = ring(-30.0, 15.0, 5)
    assert nearest(bearings, 37.5) is None
    assert nearest(bearings, math.nextafter(37.5, 0)) == 4
    assert nearest(bearings, -37.4999999999) == 0
    listed = listed_bearings([0.0, 40.0])
    assert nearest(listed, 70.0) is None
    assert nearest(listed, math.nextafter(70.0, 0)) == 1
    assert nearest(listed, -30.0) is None


def test_where_no_gap_of_a_list_is_above_60_degrees_nothing_is_outside() -> None:
    around = [float(x) for x in range(-180, 180, 60)]
    assert listed_bearings(around).ends is None
    assert nearest(listed_bearings(around), 30.0) == 3
    assert listed_bearings([*around[:-1], 121.0]).ends is not None


def test_of_equal_gaps_the_first_from_the_rear_is_outside() -> None:
    bearings = listed_bearings([90.0, 0.0, -90.0, 180.0])
    assert bearings.ends == (2, 3)
    assert nearest(bearings, -135.0) is None
    assert nearest(bearings, 45.0) == 0


# --- what closes -----------------------------------------------------------------------------------


def test_what_closes() -> None:
    assert ring(0.0, 51.4285714, 7).closes  # within 1e-6 degrees of a turn
    assert not ring(0.0, 51.42857, 7).closes
    assert uniform(0.0, 15.0001, 24) is None
    assert ring(0.0, 0.1, 3600).closes
    assert ring(0.0, -0.1, 3600).closes
    assert not ring(0.0, 0.1, 3599).closes
    assert ring(45.0, None, 1).closes


def test_bearings_are_taken_to_half_a_turn_and_do_not_add_up_errors() -> None:
    assert ring(170.0, 10.0, 3).angles == (170.0, -180.0, -170.0)
    assert ring(-135.0, 0.1, 2701).angles[1350] == 0.0
    assert listed_bearings([180.0, 540.0, -190.0]).angles == (-180.0, -180.0, 170.0)


# --- slices ----------------------------------------------------------------------------------------


def walked(angles: Sequence[float], first: float, last: float) -> tuple[int, ...]:
    """The elements met on the way from one angle counterclockwise to the other, of equal ones the lower."""
    end = last
    while end < first:
        end += 360
    met = []
    for i, b in enumerate(angles):
        offsets = [b + turn - first for turn in TURNS if first <= b + turn <= end]
        if offsets:
            met.append((min(offsets), i))
    return tuple(i for _, i in sorted(met))


def test_elements_between_two_angles() -> None:
    random = Random(8)
    of = [ring(*a).angles for a in ARCS] + [ring(-180.0, None, 24).angles, ring(0.0, -45.0, 8).angles]
    of += [tuple(float(random.randrange(-180, 180, 15)) for _ in range(9)) for _ in range(20)]
    for angles in of:
        bearings = listed_bearings(angles)
        for _ in range(60):
            first, last = (random.randrange(-360, 361, 5) / 1.0 for _ in range(2))
            if last - first <= 360:
                assert between(bearings, first, last) == walked(bearings.angles, first, last)


def test_slices_through_the_rear_and_of_a_turn() -> None:
    bearings = ring(-180.0, None, 24)
    assert between(bearings, 150.0, -150.0) == (22, 23, 0, 1, 2)
    assert between(bearings, -180.0, 180.0) == tuple(range(24))
    assert between(bearings, 0.0, 360.0) == (*range(12, 24), *range(12))
    assert between(bearings, 1.0, 14.0) == ()
    assert between(bearings, 15.0, 15.0) == (13,)
    assert sweep(170.0, -170.0) == 20
    assert sweep(-180.0, 180.0) == 360


def test_slices_are_arcs() -> None:
    bearings = ring(-180.0, None, 24)
    rear = part_by_bearing(bearings, between(bearings, 150.0, -150.0))
    assert (rear.ends, rear.closes) == ((0, 4), False)
    assert nearest(rear, 180.0) == 2
    assert nearest(rear, 142.0) is None
    clockwise = ring(60.0, -15.0, 9)
    assert part_by_index(clockwise, (2, 3, 4)).ends == (2, 0)
    assert part_by_bearing(clockwise, between(clockwise, 0.0, 30.0)).angles == (0.0, 15.0, 30.0)
    assert nearest(part_by_index(clockwise, (2, 3, 4)), 38.0) is None


def test_slices_that_reach_beyond() -> None:
    laser = ring(-135.0, 0.5, 541)
    assert not reaches_beyond(laser, -135.5, 135.5)
    assert reaches_beyond(laser, -136.0, 0.0)
    assert reaches_beyond(laser, 0.0, 136.0)
    assert reaches_beyond(laser, 170.0, -170.0)
    assert not reaches_beyond(ring(-180.0, None, 24), 100.0, -100.0)
    assert not reaches_beyond(listed_bearings([0.0, 100.0]), -30.0, 130.0)
    assert reaches_beyond(listed_bearings([0.0, 100.0]), -31.0, 100.0)


# --- names of elements -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bearings", "index", "text"),
    [
        (ring(-180, 15, 24), 15, "45 deg"),
        (ring(-180, 15, 24), 0, "-180 deg"),
        (ring(-180, 15, 24), 12, "0 deg"),
        (ring(-135, 0.5, 541), 1, "-134.5 deg"),
        (ring(0, None, 7), 1, "51.429 deg"),
        (ring(-180, None, 4096), 1, "-179.912 deg"),
        (ring(0.0004, 0.0001, 20), 0, "0"),
        (listed_bearings([90, 45, 90]), 0, "90 deg"),
        (listed_bearings([90, 45, 90]), 2, "2"),
        (None, 3, "3"),
    ],
)
def test_an_element_is_named_by_the_angle_that_selects_it(
    bearings: Bearings | None, index: int, text: str
) -> None:
    assert index_text(bearings, index) == text


@pytest.mark.parametrize("size", [1, 2, 7, 24, 113])
def test_each_angle_that_names_an_element_selects_it_again(size: int) -> None:
    bearings = ring(-180, None, size)
    for i in range(size):
        angle = naming_angle(bearings, i)
        assert angle is not None
        assert nearest(bearings, float(angle)) == i
