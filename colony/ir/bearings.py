"""Bearings: the directions along which the elements of an array look.

An angle is in degrees, counterclockwise positive, 0 ahead. Comparisons are exact: floats are taken as the
rational numbers that they are, so that no executor can round differently.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

from colony.text.wording import counted, degrees_text

TURN = 360
"""A full turn in degrees."""

LIST_STEP = 30.0
"""The step in degrees of listed bearings: an angle this far beyond an end is outside."""

_LARGEST_INNER_GAP = 60
"""The largest angle in degrees between neighbors of a list that is still inside."""

_CLOSED_WITHIN = Fraction(1, 10**6)
"""The angle in degrees within which elements that take a turn are a ring that closes."""

_ROUNDING = 1e-6
"""An upper bound, in degrees, on the rounding of distances in floats: nearer ones are compared exactly."""


@dataclass(frozen=True, slots=True)
class Bearings:
    """The bearing of each element of an array.

    Attributes:
        angles: bearings in degrees, each in [-180, 180).
        step: angle from each element to the next, negative where they go clockwise; None for listed bearings.
        ends: indices of the first and the last element counterclockwise, beyond which there is none; None
            for a ring that closes, and for a list without a large gap.
        closes: True for a ring that closes, whose plain indices wrap.
    """

    angles: tuple[float, ...]
    step: float | None
    ends: tuple[int, int] | None
    closes: bool = False

    @property
    def spacing(self) -> float:
        """Return the angle in degrees between neighbors, for a list the one that stands for it."""
        return LIST_STEP if self.step is None else abs(self.step)


def uniform(start: float, step: float | None, size: int) -> Bearings | None:
    """Return the bearings START + i * STEP of `size` elements, None if they take more than a turn.

    Without a step they are a ring that closes. `start` and `step` are decimals as they print, so that 0.1
    means a tenth.
    """
    first = Fraction(repr(start))
    exact_step = Fraction(TURN, size) if step is None else Fraction(repr(step))
    taken = size * abs(exact_step)
    closes = abs(taken - TURN) <= _CLOSED_WITHIN
    if taken > TURN and not closes:
        return None
    angles = tuple(_normal(first + i * exact_step) for i in range(size))
    ends = (0, size - 1) if exact_step >= 0 else (size - 1, 0)
    return Bearings(angles, float(exact_step), None if closes else ends, closes)


def too_many_hint(step: float, size: int) -> str:
    """Return a hint for `size` elements that take more than a turn, `step` degrees apart."""
    exact = abs(Fraction(repr(step)))
    fitting = int((TURN + _CLOSED_WITHIN) / exact)
    if fitting == size - 1 and abs(fitting * exact - TURN) <= _CLOSED_WITHIN:
        return f"the last element looks where the first one does: drop it, and declare {fitting} elements"
    ring = f"a ring of {size} elements has a step of {degrees_text(TURN / size)}"
    return f"{ring}; a turn has room for {counted(fitting, 'element')} of {degrees_text(step)}"


def listed_bearings(angles: Iterable[float]) -> Bearings:
    """Return bearings in any order.

    Their ends lie on both sides of the largest gap, of equal gaps the first counterclockwise from -180
    degrees; without a gap above 60 degrees they have none.
    """
    normal = tuple(_normal(Fraction(repr(angle))) for angle in angles)
    order = sorted(set(normal))
    gaps = [(_gap(a, b), a, b) for a, b in zip(order, [*order[1:], order[0]], strict=True)]
    largest, before, after = max(gaps, key=lambda gap: gap[0])
    ends = normal.index(after), normal.index(before)
    return Bearings(normal, None, ends if largest > _LARGEST_INNER_GAP else None)


def part_by_index(bearings: Bearings, indices: tuple[int, ...]) -> Bearings:
    """Return the bearings of a slice by whole indices, whose elements are in the array's order."""
    if bearings.step is None:
        return listed_bearings(bearings.angles[i] for i in indices)
    return _arc(bearings, indices, bearings.step)


def part_by_bearing(bearings: Bearings, indices: tuple[int, ...]) -> Bearings:
    """Return the bearings of a slice by bearing, whose elements are in counterclockwise order."""
    return _arc(bearings, indices, None if bearings.step is None else abs(bearings.step))


def _arc(bearings: Bearings, indices: tuple[int, ...], step: float | None) -> Bearings:
    """Return the bearings of some elements, the first and the last of which are the ends."""
    last = len(indices) - 1
    ends = (last, 0) if step is not None and step < 0 else (0, last)
    return Bearings(tuple(bearings.angles[i] for i in indices), step, ends)


def nearest(bearings: Bearings, angle: float) -> int | None:
    """Return the index of the element nearest to an angle, of two the lower.

    The angle is first taken to [0, 360), rounded to a float as `mod` rounds it.
    None if the angle is not finite, or is outside: beyond the ends by half a step or more (30 degrees or more
    where the bearings are listed). `lookup` is the same function as a table.
    """
    if not math.isfinite(angle):
        return None
    turned = angle % TURN
    exact = Fraction(turned)
    if bearings.ends is not None:
        first, last = bearings.ends
        gap = _gap(bearings.angles[last], bearings.angles[first])
        beyond = (exact - Fraction(bearings.angles[last])) % TURN
        if 0 < beyond < gap and min(beyond, gap - beyond) >= margin(bearings):
            return None
    near = [abs((b - turned + TURN / 2) % TURN - TURN / 2) for b in bearings.angles]
    limit = min(near) + _ROUNDING
    candidates = [i for i, distance in enumerate(near) if distance <= limit]
    return min(candidates, key=lambda i: _distance(Fraction(bearings.angles[i]), exact))


def margin(bearings: Bearings) -> Fraction:
    """Return how far beyond the ends, in degrees, an angle is outside."""
    return Fraction(LIST_STEP) if bearings.step is None else Fraction(repr(abs(bearings.step))) / 2


@lru_cache(maxsize=64)  # functions take the same slice in each call
def between(bearings: Bearings, first: float, last: float) -> tuple[int, ...]:
    """Return the indices of the elements from one angle counterclockwise to another, both included."""
    start, width = Fraction(repr(first)), sweep(first, last)
    offsets = [((Fraction(repr(b)) - start) % TURN, i) for i, b in enumerate(bearings.angles)]
    return tuple(i for offset, i in sorted(offsets) if offset <= width)


def sweep(first: float, last: float) -> Fraction:
    """Return the angle in degrees from `first` counterclockwise to `last`, at most a turn."""
    width = Fraction(repr(last)) - Fraction(repr(first))
    return width if 0 <= width <= TURN else width % TURN


def reaches_beyond(bearings: Bearings, first: float, last: float) -> bool:
    """Return True if a slice reaches more than one step beyond the ends of the bearings."""
    if bearings.ends is None:
        return False
    low, high = bearings.ends
    step = Fraction(repr(bearings.spacing))
    gap = _gap(bearings.angles[high], bearings.angles[low])
    bare = gap - 2 * step  # the part of the gap that is more than a step from both ends
    into = (Fraction(repr(first)) - Fraction(bearings.angles[high]) - step) % TURN or TURN
    return bare > 0 and (into < bare or into + sweep(first, last) > TURN)


def _normal(angle: Fraction) -> float:
    """Return an angle taken to [-180, 180)."""
    turned = float((angle + TURN // 2) % TURN - TURN // 2)
    return -180.0 if turned == 180.0 else turned


def _gap(before: float, after: float) -> Fraction:
    """Return the angle from one bearing counterclockwise to the next; from a bearing to itself, a turn."""
    return (Fraction(after) - Fraction(before)) % TURN or Fraction(TURN)


def _distance(a: Fraction, b: Fraction) -> Fraction:
    """Return the angle between two directions, at most half a turn."""
    turned = (a - b) % TURN
    return min(turned, TURN - turned)


# --- names of elements -----------------------------------------------------------------------------

_DECIMALS = 3


def naming_angle(bearings: Bearings | None, index: int) -> str | None:
    """Return the angle in degrees that names an element: `-7.5`.

    It has at most three decimals and, as an index, selects exactly this element. None if no such angle does:
    the array has no bearings, an element with a lower index looks along the same one, or they are too dense.
    """
    if bearings is None:
        return None
    text = f"{bearings.angles[index]:.{_DECIMALS}f}".rstrip("0").rstrip(".")
    text = "0" if text == "-0" else text
    return text if nearest(bearings, float(text)) == index else None


def index_text(bearings: Bearings | None, index: int) -> str:
    """Return an element's index as tests and people write it: `-7.5 deg`, or `12` if no angle names it."""
    angle = naming_angle(bearings, index)
    return str(index) if angle is None else f"{angle} deg"


# --- lookup ----------------------------------------------------------------------------------------
#
# `nearest` is the meaning, and what the interpreter computes. `lookup` is the same function as a table of
# floats, which compiled programs and proofs have; tests/ir/test_bearings.py holds one to the other.
#
# Beams at 0, 90, 180 and -90 degrees have the pieces "up to 45 beam 0, up to 135 beam 1, up to 225 beam 2,
# below 315 beam 3, and from there beam 0 again". At 45 and at 315 two beams are equally near, and the lower
# index counts. Each piece ends at a float that belongs to it, so that executors count the breaks below an
# angle: the piece of beam 3 ends at the greatest float below 315.


@dataclass(frozen=True, slots=True)
class Lookup:
    """`nearest` as a step function of an angle in [0, 360].

    The element is `indices[n]`, where n is the number of `breaks` below the angle; None is outside.
    """

    breaks: tuple[float, ...]
    indices: tuple[int | None, ...]


def lookup(bearings: Bearings) -> Lookup:
    """Return `nearest` as a step function, for angles in [0, 360]: `mod` may round an angle up to 360."""
    breaks, indices = list[float](), list[int | None]()
    for last, index in sorted(_pieces(bearings), key=lambda piece: piece[0]):
        if breaks and breaks[-1] >= last:
            continue  # the piece has no float
        breaks.append(last)
        indices.append(index)
    if breaks[0] >= 0:
        return Lookup(tuple(breaks), (*indices, indices[0]))
    # The first piece ends right below 0, as where two beams meet at 0 degrees. So it reaches to the greatest
    # float below 360; 360 itself is 0, and belongs to the next piece.
    breaks.append(math.nextafter(TURN, 0))
    return Lookup(tuple(breaks), (*indices, indices[0], indices[1]))


def _pieces(bearings: Bearings) -> Iterator[tuple[float, int | None]]:
    """Yield, around the turn, the last float of each piece and its element, None for the outside."""
    by_direction: dict[Fraction, int] = {}
    for i, angle in enumerate(bearings.angles):
        by_direction.setdefault(Fraction(angle) % TURN, i)
    order, edge = sorted(by_direction), margin(bearings)
    last = None if bearings.ends is None else Fraction(bearings.angles[bearings.ends[1]]) % TURN
    for here, there in zip(order, [*order[1:], order[0]], strict=True):
        i, j = by_direction[here], by_direction[there]
        gap = (there - here) % TURN or Fraction(TURN)
        if here == last and gap >= 2 * edge:
            yield _last_float(here + edge, inclusive=False), i
            yield _last_float(there - edge, inclusive=True), None
        else:
            yield _last_float(here + gap / 2, inclusive=i <= j), i


def _last_float(limit: Fraction, *, inclusive: bool) -> float:
    """Return the greatest float up to a limit that is taken to [0, 360), or below it."""
    turned = limit % TURN
    last = float(turned)
    while Fraction(last) > turned or (not inclusive and Fraction(last) == turned):
        last = math.nextafter(last, -math.inf)
    return last
