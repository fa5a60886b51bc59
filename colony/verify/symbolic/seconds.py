"""Times as numbers: nanoseconds / 1e9."""

from __future__ import annotations

from fractions import Fraction

import z3

from colony.text.source import Span
from colony.verify.symbolic.builder import Builder
from colony.verify.symbolic.logic import FALSE, real
from colony.verify.symbolic.system import Bounds, Inexact, Number, Reason

_NANOSECOND = real(Fraction(1, 10**9))


def seconds(nanoseconds: z3.ArithRef, builder: Builder, span: Span) -> Number:
    """Return a time of at least 0 `nanoseconds` (a term of sort Int) as a number of seconds."""
    value = z3.ToReal(nanoseconds) * _NANOSECOND
    result = Number(value, FALSE, FALSE, Bounds(Fraction(0)), nanoseconds=nanoseconds)
    builder.mark_number_inexact(
        result, Reason(Inexact.ROUNDING, span, "a time in seconds: reals in place of floats")
    )
    return result
