"""The text of values in an answer: with as many digits as the answer needs."""

from __future__ import annotations

import math

from colony.ir.types import Array, Bool, Enum, Quantity, ScalarValue, Type, Value, element_type, unit_shown
from colony.verify.reference.kleene import Known
from colony.verify.sparse import sparse_text

_DIGITS = (4, 6, 9, 12, 17)
"""Numbers of significant digits that are tried, until two values differ in their text."""

_MAX_ELEMENTS = 8
"""Maximum number of elements of an array that are shown."""


def value_text(value: Known, type_: Type, digits: int = _DIGITS[0]) -> str:
    """Return a value with its unit; "missing" for one that is not known."""
    if value is None:
        return "missing"
    if not isinstance(value, tuple):
        return scalar_text(value, type_, digits)
    assert isinstance(type_, Array)
    if None not in value and len(value) > _MAX_ELEMENTS:
        known = tuple(x for x in value if x is not None)
        text = sparse_text(known, type_, lambda x: scalar_text(x, type_, digits))
        if text is not None:
            return text
    more = ", ..." if len(value) > _MAX_ELEMENTS else ""
    return f"[{', '.join(value_text(x, type_.element, digits) for x in value[:_MAX_ELEMENTS])}{more}]"


def scalar_text(value: ScalarValue, type_: Type, digits: int = _DIGITS[0]) -> str:
    """Return a scalar, or one element of an array, with its unit."""
    match element_type(type_):
        case Bool():
            return "true" if value else "false"
        case Enum(name=name, members=members):
            return next((f"{name}.{member}" for member, n in members if n == value), _number(value, digits))
        case Quantity() as quantity:
            unit = unit_shown(quantity)
            text = _number(value / float(unit.factor), digits)
            return text if unit.text == "number" else f"{text} {unit.text}"


def pair_text(left: Value, right: Value, left_type: Type, right_type: Type) -> tuple[str, str]:
    """Return the texts of two values, with enough digits to tell them apart if they differ."""
    texts = "", ""
    for digits in _DIGITS:
        texts = value_text(left, left_type, digits), value_text(right, right_type, digits)
        if texts[0] != texts[1] or left == right:
            break
    return texts


def gap_text(left: Value, right: Value, type_: Type) -> str | None:
    """Return the distance between two numbers, None where there is no finite one."""
    if isinstance(left, tuple | bool) or isinstance(right, tuple | bool):
        return None
    gap = abs(left - right)
    if not isinstance(type_, Quantity) or not math.isfinite(gap):
        return None
    return scalar_text(gap, type_, 3)


def _number(x: float, digits: int) -> str:
    text = f"{x:.{digits}g}"
    if "e" in text and math.isfinite(x) and 1e-4 <= abs(x) < 1e9:
        return f"{x:.0f}" if abs(x) >= 1 else f"{x:.{digits}f}"
    return text
