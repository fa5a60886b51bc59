"""Geometry of polar pictures: directions, sectors and scales, without a drawing library.

The picture is seen from above: bearing 0 is up, and bearings grow counterclockwise, so that 90 degrees is
left (REP 103). The radius of the outermost ring is 1.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from colony.ir.bearings import LIST_STEP, TURN, Bearings, margin

MAX_RINGS = 5
_ARC_STEP_DEG = 3.0
"""Angle between the points by which arcs are drawn."""
_SMALLEST = 1e-290
"""Least span of a scale; below it, quotients of floats lose their precision."""


class PicturePoint(NamedTuple):
    """A point in the picture: x to the right, y up, in radii of the outermost ring."""

    x: float
    y: float


class Sector(NamedTuple):
    """A part of the turn, in degrees, from `start` counterclockwise to `end`; `end` is at least `start`."""

    start: float
    end: float

    @property
    def width(self) -> float:
        """Width in degrees."""
        return self.end - self.start

    @property
    def middle(self) -> float:
        """The bearing halfway between the edges."""
        return (self.start + self.end) / 2


def point(bearing: float, radius: float) -> PicturePoint:
    """Return the point at a bearing in degrees and a radius."""
    angle = math.radians(bearing)
    return PicturePoint(-radius * math.sin(angle), radius * math.cos(angle))


def outline(sector: Sector, inner: float, outer: float) -> list[PicturePoint]:
    """Return the corners of a sector between two radii, counterclockwise; with `inner` 0 it has a tip."""
    steps = max(1, math.ceil(sector.width / _ARC_STEP_DEG))
    bearings = [sector.start + sector.width * i / steps for i in range(steps + 1)]
    if inner <= 0.0:
        return [PicturePoint(0.0, 0.0), *(point(b, outer) for b in bearings)]
    return [*(point(b, outer) for b in bearings), *(point(b, inner) for b in reversed(bearings))]


def sectors(bearings: Bearings, widest: float = float(TURN)) -> tuple[Sector, ...]:
    """Return the sector of each element: halfway to its neighbors, and at most `widest` degrees wide.

    Listed elements, whose neighbors may be far, are at most `LIST_STEP` degrees wide; those along one bearing
    have the same sector.
    """
    halves = _half_widths(bearings)
    return tuple(
        Sector(angle - min(before, widest / 2), angle + min(after, widest / 2))
        for angle, (before, after) in zip(bearings.angles, halves, strict=True)
    )


def _half_widths(bearings: Bearings) -> list[tuple[float, float]]:
    """Return how far each element's sector reaches clockwise and counterclockwise."""
    if bearings.step is not None:
        half = min(abs(bearings.step), TURN) / 2
        return [(half, half)] * len(bearings.angles)
    order = sorted(set(bearings.angles))
    limit = LIST_STEP / 2
    widths = {}
    for i, angle in enumerate(order):
        before = (angle - order[i - 1]) % TURN or TURN
        after = (order[(i + 1) % len(order)] - angle) % TURN or TURN
        widths[angle] = (min(before / 2, limit), min(after / 2, limit))
    return [widths[angle] for angle in bearings.angles]


def blind_sector(bearings: Bearings) -> Sector | None:
    """Return the sector in which every angle is outside the array, None if no angle is."""
    if bearings.ends is None:
        return None
    first, last = (bearings.angles[i] for i in bearings.ends)
    gap, edge = (first - last) % TURN or TURN, float(margin(bearings))
    return Sector(last + edge, last + gap - edge) if gap > 2 * edge else None


class RadialPlace(NamedTuple):
    """The place of an element among the `total` elements along one bearing, from the robot outward."""

    number: int
    total: int


def layers(bearings: Bearings) -> tuple[RadialPlace, ...]:
    """Return the place of each element among those along its bearing, in the order of their indices."""
    counts, before = Counter(bearings.angles), Counter[float]()
    placed = []
    for angle in bearings.angles:
        placed.append(RadialPlace(before[angle], counts[angle]))
        before[angle] += 1
    return tuple(placed)


# --- scales --------------------------------------------------------------------------------------


class RadialScale(NamedTuple):
    """A linear scale: `low` at the center, `high` at the outermost ring, and the values of all rings."""

    low: float
    high: float
    rings: tuple[float, ...]

    def radius(self, value: float) -> float:
        """Return the radius of a value, from 0 to 1."""
        span = self.high / 2 - self.low / 2  # halves: the difference itself may exceed all floats
        return min(max((value / 2 - self.low / 2) / span, 0.0), 1.0)


def scale_of(values: Iterable[float], *, otherwise: float = 1.0) -> RadialScale:
    """Return a scale with 2 to 5 round rings that covers 0 and the finite values.

    `otherwise` is the value to be covered if there is none but 0.
    """
    finite = [v for v in values if math.isfinite(v)]
    low, high = min([0.0, *finite]), max([0.0, *finite])
    if high / 2 - low / 2 < _SMALLEST:
        high = otherwise
    step = _round_step(high / MAX_RINGS - low / MAX_RINGS)
    first, last = math.floor(low / step), math.ceil(high / step)
    if last - first > MAX_RINGS:  # both ends were rounded outward
        step = _round_step(step * 1.01)
        first, last = math.floor(low / step), math.ceil(high / step)
    rings = [_product(step, k) for k in range(first, last + 1)]
    return RadialScale(rings[0], rings[-1], tuple(rings[1:]))


def _round_step(least: float) -> float:
    """Return the least 1, 2 or 5 times a power of ten that is not below `least`."""
    power = math.floor(math.log10(least))
    candidates = (float(f"{digit}e{power + up}") for up in (0, 1) for digit in (1, 2, 5))
    return next((c for c in candidates if c >= least * (1 - 1e-9)), least)


def _product(step: float, k: int) -> float:
    """Return `k * step` without the noise of binary fractions, within the finite floats."""
    value = float(f"{step * k:.12g}")
    return value if math.isfinite(value) else math.copysign(1.7e308, value)


def label_bearing(radii: Sequence[tuple[float, float]], blind: Sector | None) -> float:
    """Return the bearing for the labels of the rings: in the blind sector, or else beside few points.

    Args:
        radii: The bearing and the radius of each point that is drawn.
        blind: The sector without elements.
    """
    if blind is not None and blind.width >= 2 * _LABEL_DEG:
        return blind.middle
    crowds = Counter(
        candidate
        for candidate in _LABEL_BEARINGS
        for bearing, radius in radii
        if radius < 1.0 and abs((bearing - candidate + TURN / 2) % TURN - TURN / 2) < _LABEL_DEG
    )
    return min(_LABEL_BEARINGS, key=lambda b: crowds[b])


_LABEL_DEG = 11.0
_LABEL_BEARINGS = (-67.5, -112.5, 67.5, 112.5, -22.5, -157.5, 22.5, 157.5)
