"""Random readings for a sensor: at, next to and between a program's thresholds, and invalid in many ways."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping
from fractions import Fraction
from itertools import pairwise
from typing import assert_never

from colony.ir import expression as ir
from colony.ir.bearings import TURN, Bearings, lookup
from colony.ir.frame import Reading
from colony.ir.program import Sensor
from colony.ir.types import Array, Bool, Enum, Quantity, Scalar, ScalarValue, element_type
from colony.text.units import ANGLE, Dimension
from colony.verify.testing.drawing import Choices

ODD_READINGS: tuple[Reading, ...] = (
    None,
    math.nan,
    math.inf,
    -math.inf,
    True,
    1e300,
    10**400,
    "high",  # type: ignore[assignment]  # a faulty server sends anything
    (),
    (1.0, math.nan),
    3,
)
"""Readings that are invalid for most sensors, each for a different reason."""

PLAIN_NUMBERS = (0.0, 1.0, 2, -1, -0.0, 2.5, 100.0, 0.5, -7.25, 1e12)
"""Plain numbers in declared units, for any sensor."""

Thresholds = Mapping[Dimension, tuple[float, ...]]
"""Numbers of each dimension, in base units, sorted."""

_MAX_THRESHOLDS = 40
_MAX_BREAKS = 16


def thresholds_among(nodes: Iterable[ir.Expression]) -> Thresholds:
    """Return finite constants among expressions, sorted by dimension; at most `_MAX_THRESHOLDS` of each.

    Of elements along an angle they are the angles where the nearest one changes.
    """
    found: dict[Dimension, dict[float, None]] = {}
    for node in nodes:
        match node:
            case ir.Nearest(bearings=bearings):
                found.setdefault(ANGLE, {}).update(dict.fromkeys(_breaks_of(bearings)))
                continue
            case ir.UnaryOperation(operator=ir.Unary.NEGATE, operand=ir.Constant() as constant):
                sign = -1.0
            case ir.Constant() as constant:
                sign = 1.0
            case _:
                continue
        of = element_type(constant.type)
        if isinstance(of, Quantity):
            for value in constant.value if isinstance(constant.value, tuple) else (constant.value,):
                if math.isfinite(value):
                    found.setdefault(of.dimension, {})[sign * value] = None
    return {dimension: tuple(sorted([*of][:_MAX_THRESHOLDS])) for dimension, of in found.items()}


def _breaks_of(bearings: Bearings) -> list[float]:
    """Return angles in [-180, 180) where the nearest element changes, a few of many."""
    breaks = lookup(bearings).breaks
    some = breaks[:: -(-len(breaks) // _MAX_BREAKS)]
    return [float((Fraction(b) + TURN // 2) % TURN - TURN // 2) for b in some]


def draw_reading(choices: Choices, sensor: Sensor, thresholds: Thresholds) -> Reading:
    """Draw a reading of a sensor in its declared unit, or occasionally a missing or invalid one.

    What an actuator was given last is never infinite.
    """
    reading = _draw_reading(choices, sensor, thresholds)
    if sensor.sent is not None and isinstance(reading, int | float):
        most = sys.float_info.max
        if abs(reading) > most or abs(reading * sensor.factor) > most:
            return None
    return reading


def _draw_reading(choices: Choices, sensor: Sensor, thresholds: Thresholds) -> Reading:
    if choices.one_in(16):
        return None
    if choices.one_in(20):
        return choices.pick(ODD_READINGS)
    if not isinstance(sensor.type, Array):
        return _scalar(choices, sensor.type, sensor, thresholds)
    size = sensor.type.size
    if choices.one_in(30):
        size = max(0, size + choices.pick((1, -1)))
    elements = _elements(choices, sensor.type.element, size, sensor, thresholds)
    return tuple(elements) if choices.one_in(2) else elements


def _elements(
    choices: Choices, of: Scalar, size: int, sensor: Sensor, thresholds: Thresholds
) -> list[ScalarValue | int]:
    """Draw elements: all equal, equal except for some runs, from a few values, or independent.

    Programs compute the minimum of a region, or count the elements below a threshold. With independent
    elements the results would be nearly the same every time.
    """

    def draw() -> ScalarValue | int:
        return _scalar(choices, of, sensor, thresholds)

    kind = choices.up_to(5)
    if kind >= 5:
        return [draw() for _ in range(size)]
    values = [draw()] * size
    if kind == 4:
        few = [draw() for _ in range(choices.between(2, 4))]
        return [choices.pick(few) for _ in range(size)]
    for _ in range((0, 1, 1, 2)[kind] if size else 0):
        other, first, length = draw(), choices.up_to(size - 1), choices.between(1, max(1, size // 2))
        for i in range(first, first + length):
            values[i % size] = other
    return values


def _scalar(choices: Choices, of: Scalar, sensor: Sensor, thresholds: Thresholds) -> ScalarValue | int:
    match of:
        case Bool():
            return choices.up_to(1) == 1
        case Enum(members=members):
            value = choices.pick(members)[1]
            return int(value) if value.is_integer() and choices.one_in(3) else value
        case Quantity(dimension=dimension):
            if choices.one_in(4):
                return choices.pick(PLAIN_NUMBERS)
            bounds = [x for x in (sensor.low, sensor.high) if x is not None]
            numbers = sorted({*thresholds.get(dimension, ()), *bounds})
            return _number(choices, numbers) / sensor.factor if numbers else choices.pick(PLAIN_NUMBERS)
        case _:
            assert_never(of)


def _number(choices: Choices, numbers: list[float]) -> float:
    """Return one of the numbers, a number between or beyond them, or a float adjacent to one of them."""
    between = [a + (b - a) / 2 for a, b in pairwise(numbers)]
    beyond = [numbers[-1] * 2 + 1, numbers[0] - abs(numbers[0]) - 1]
    match choices.up_to(4):
        case 0 | 1:
            return choices.pick((*between, *beyond))
        case 2 | 3:
            return choices.pick(numbers)
        case _:
            return math.nextafter(choices.pick(numbers), choices.pick((math.inf, -math.inf)))
