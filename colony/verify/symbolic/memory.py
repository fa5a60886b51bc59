"""The memory functions of the language: their cells and values.

The memory of a call advances in frames in which its owner is evaluated (`advances`). Cells with equal initial
values and equal terms are always equal, and are shared, so that a contract may refer to the memory of a
module or node.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import assert_never, cast

import z3

from colony.ir import expression as ir
from colony.ir.types import Bool, Enum, ScalarValue, any_value
from colony.ir.types import Scalar as ScalarType
from colony.text.source import Span
from colony.verify.symbolic.bounding import within
from colony.verify.symbolic.builder import SymbolicValues, SystemBuilder
from colony.verify.symbolic.cases import constant, constant_of, whole_of, with_cases
from colony.verify.symbolic.logic import (
    FALSE,
    all_of,
    any_of,
    both,
    choice,
    either,
    implied,
    integer,
    is_false,
    is_true,
    negation,
    pick,
    real,
    truth,
)
from colony.verify.symbolic.numbers import equal, select
from colony.verify.symbolic.system import ExtendedReal, Inexact, NumberBounds, Reason, Scalar, Shape

# --- seconds ------------------------------------------------------------------------------------------
#
# Times as numbers: nanoseconds / 1e9.

_NANOSECOND = real(Fraction(1, 10**9))


def seconds(nanoseconds: z3.ArithRef, builder: SystemBuilder, span: Span) -> ExtendedReal:
    """Return a time of at least 0 `nanoseconds` (a term of sort Int) as a number of seconds."""
    value = z3.ToReal(nanoseconds) * _NANOSECOND
    result = ExtendedReal(value, FALSE, FALSE, NumberBounds(Fraction(0)), nanoseconds=nanoseconds)
    builder.mark_number_inexact(
        result, Reason(Inexact.ROUNDING, span, "a time in seconds: reals in place of floats")
    )
    return result


# --- memory -------------------------------------------------------------------------------------------


def recall(
    e: ir.MemoryCall,
    x: Sequence[Scalar],
    types: Sequence[ScalarType],
    builder: SystemBuilder,
    frame_values: SymbolicValues,
    advances: z3.BoolRef,
    hint: str,
) -> Scalar:
    """Return the value of a memory function of scalars; its cells advance where `advances` holds."""
    memory = Memory(builder, frame_values, advances, f"{hint}.{e.function.value}")
    match e.function:
        case ir.MemoryFunction.PREVIOUS:
            return memory.previous(x[0], types[0], x[1])
        case ir.MemoryFunction.CHANGED:
            return both(memory.evaluated(), negation(equal(x[0], memory.last(x[0], types[0]))))
        case ir.MemoryFunction.RISING:
            return both(_truth(x[0]), negation(_truth(memory.last(x[0], types[0]))))
        case ir.MemoryFunction.FALLING:
            return both(negation(_truth(x[0])), _truth(memory.last(x[0], types[0])))
        case ir.MemoryFunction.RECENTLY:
            return memory.recently(_truth(x[0]), e.duration_ns)
        case ir.MemoryFunction.SUSTAINED:
            return memory.sustained(_truth(x[0]), e.duration_ns)
        case ir.MemoryFunction.ELAPSED:
            return seconds(memory.elapsed_ns(_truth(x[0])), builder, e.span)
        case ir.MemoryFunction.LATCH:
            return memory.latch(_truth(x[0]), _truth(x[1]))
        case ir.MemoryFunction.CAPTURED:
            return memory.captured(x[0], types[0], x[1], types[1])
        case ir.MemoryFunction.EVERY:
            return memory.every(e.duration_ns)
        case _:
            assert_never(e.function)


def _truth(x: Scalar) -> z3.BoolRef:
    assert not isinstance(x, ExtendedReal)
    return x


class Memory:
    """Creates cells that advance in every frame in which `advances` holds."""

    def __init__(
        self, builder: SystemBuilder, frame_values: SymbolicValues, advances: z3.BoolRef, hint: str
    ) -> None:
        self.builder = builder
        self.frame_values = frame_values
        self.advances = advances
        self.hint = hint

    def evaluated(self) -> z3.BoolRef:
        """Return the condition that memory advanced in an earlier frame."""
        if is_true(self.advances):
            return self.frame_values.begun
        key = ("evaluated", *self.builder.keep(self.advances))
        return self.builder.once(key, lambda: self._ever("evaluated", self.advances))

    def _ever(self, what: str, event: z3.BoolRef) -> z3.BoolRef:
        """Return the condition that `event` was true in an earlier frame."""
        ever, close = self._flag(what)
        close(either(ever, event))
        self.builder.invariant(ever, implied(ever, self.frame_values.begun))
        return ever

    def _flag(self, what: str) -> tuple[z3.BoolRef, Callable[[z3.BoolRef], None]]:
        """Return a new cell, initially false, and the function that sets its value after the frame."""
        name = self.builder.name(f"{self.hint}.{what}")
        old = cast(z3.BoolRef, self.builder.open_cell(name, z3.BoolSort(), FALSE))
        return old, lambda x: self.builder.close_cell(name, x)

    # --- values ----------------------------------------------------------------------------------

    def last(self, x: Scalar, of: ScalarType, initial: ScalarValue | None = None) -> Scalar:
        """Return `x` in the last frame in which memory advanced; before the first, `initial` or any value."""
        start = any_value(of) if initial is None else initial
        key = ("last", repr(start), *self.builder.keep(self.advances), *self.builder.key(x))

        def make() -> Scalar:
            old, set_next = open_scalar_cell(self.builder, f"{self.hint}.last", of, start)
            set_next(select(self.advances, x, old))
            return old

        return self.builder.once(key, make)

    def previous(self, x: Scalar, of: ScalarType, initial: Scalar) -> Scalar:
        """Return `x` in the last frame in which memory advanced, initially `initial`."""
        start = _known(initial)
        if start is not None:
            return self.last(x, of, start)
        return select(self.evaluated(), self.last(x, of), initial)

    def captured(self, x: Scalar, of: ScalarType, key: Scalar, key_type: ScalarType) -> Scalar:
        """Return `x` in the first frame with the current key."""
        known = _known(key)
        if known is not None:
            same_key = truth(known == known)  # a NaN is never the same key
        else:
            same_key = equal(self.last(key, key_type), key)
        keeps = both(self.evaluated(), same_key)
        if is_false(keeps):
            return x
        term_ids = (*self.builder.keep(self.advances, keeps), *self.builder.key(x))

        def make() -> Scalar:
            old, set_next = open_scalar_cell(self.builder, f"{self.hint}.value", of, any_value(of))
            value = select(keeps, old, x)
            set_next(select(self.advances, value, old))
            return value

        return self.builder.once(("captured", *term_ids), make)

    def latch(self, set_: z3.BoolRef, reset: z3.BoolRef) -> z3.BoolRef:
        """Return `v = (v or set) and not reset`, with immediate effect."""

        def make() -> z3.BoolRef:
            old, close = self._flag("set")
            latched = both(either(old, set_), negation(reset))
            close(choice(self.advances, latched, old))
            return latched

        return self.builder.once(("latch", *self.builder.keep(self.advances, set_, reset)), make)

    # --- times -----------------------------------------------------------------------------------

    def recently(self, b: z3.BoolRef, duration_ns: int) -> z3.BoolRef:
        """Return the condition that `b` is true, or was true less than `duration_ns` ago."""
        if duration_ns <= 0:
            return b
        ever, time = self._time_of(both(self.advances, b))
        recent = cast(z3.BoolRef, self.frame_values.now - time < integer(duration_ns))
        return either(b, both(ever, recent))

    def sustained(self, b: z3.BoolRef, duration_ns: int) -> z3.BoolRef:
        """Return the condition that `b` was true in every frame since one at least `duration_ns` ago.

        A frame in which memory does not advance counts as one in which `b` was false.
        """
        if duration_ns <= 0:
            return b
        on = both(self.advances, b)

        def make() -> tuple[z3.BoolRef, z3.ArithRef]:
            was, close = self._flag("was")
            close(on)
            return was, self._time("since", both(on, negation(was)))

        was, since = self.builder.once(("sustained", *self.builder.keep(on)), make)
        long_enough = cast(z3.BoolRef, self.frame_values.now - since >= integer(duration_ns))
        return all_of((b, was, long_enough))

    def _time_of(self, event: z3.BoolRef) -> tuple[z3.BoolRef, z3.ArithRef]:
        """Return the condition that `event` was true in an earlier frame, and the last time it was."""

        def make() -> tuple[z3.BoolRef, z3.ArithRef]:
            return self._ever("ever", event), self._time("time", event)

        return self.builder.once(("time of", *self.builder.keep(event)), make)

    def _time(self, what: str, event: z3.BoolRef) -> z3.ArithRef:
        """Return the time of the last frame with `event`, 0 before the first."""
        time, close = self._open_time(what)
        close(pick(event, self.frame_values.now, time))
        return time

    def _open_time(self, what: str) -> tuple[z3.ArithRef, Callable[[z3.ArithRef], None]]:
        name = self.builder.name(f"{self.hint}.{what}")
        time = cast(z3.ArithRef, self.builder.open_cell(name, z3.IntSort(), integer(0)))
        self.builder.invariant(time, z3.And(time >= 0, time <= self.frame_values.last))
        return time, lambda x: self.builder.close_cell(name, x)

    def elapsed_ns(self, b: z3.BoolRef) -> z3.ArithRef:
        """Return the time since `b` became true, 0 while it is false."""
        on = _truth(self.last(b, Bool(), False))
        became = all_of((self.advances, b, negation(on)))
        key = ("since", *self.builder.keep(became))
        since = self.builder.once(key, lambda: self._time("since", became))
        return pick(both(b, on), self.frame_values.now - since, cast(z3.ArithRef, integer(0)))

    def every(self, duration_ns: int) -> z3.BoolRef:
        """Return the condition that is true initially, and then `duration_ns` after it was last true."""

        def make() -> z3.BoolRef:
            time, close = self._open_time("time")
            passed = cast(z3.BoolRef, self.frame_values.now >= time + integer(duration_ns))
            due = either(negation(self.evaluated()), passed)
            close(pick(both(self.advances, due), self.frame_values.now, time))
            return due

        return self.builder.once(("every", duration_ns, *self.builder.keep(self.advances)), make)


# --- cells of any type ---------------------------------------------------------------------------


def open_scalar_cell(
    builder: SystemBuilder, hint: str, of: ScalarType, initial: ScalarValue
) -> tuple[Scalar, Callable[[Scalar], None]]:
    """Open the cells of a scalar; return its old value and the function that sets its next value."""
    name = builder.name(hint)
    if isinstance(of, Bool):
        old = builder.open_cell(name, z3.BoolSort(), truth(bool(initial)))
        return cast(z3.BoolRef, old), lambda x: builder.close_cell(name, _truth(x))
    assert not isinstance(initial, bool)
    start = constant(initial)
    if isinstance(of, Enum):
        return _enumerator(builder, name, of, start)
    return _number(builder, name, start)


def _enumerator(
    builder: SystemBuilder, name: str, of: Enum, start: ExtendedReal
) -> tuple[Scalar, Callable[[Scalar], None]]:
    """Open the cells of an enumerator, with one for NaN only if an element that is outside can get there."""
    old = cast(z3.ArithRef, builder.open_cell(name, z3.RealSort(), start.value))
    value, shape = enumerator(old, of), builder.shapes.get(name)
    if shape is not None and shape.nan:
        nan = cast(z3.BoolRef, builder.open_cell(f"{name}.nan", z3.BoolSort(), start.nan))
        cases = [(v, both(negation(nan), condition)) for v, condition in value.cases]
        value = with_cases(old, (*cases, (math.nan, nan)))
    builder.invariant(old, any_of(c for _, c in value.cases))

    def close(x: Scalar) -> None:
        assert isinstance(x, ExtendedReal)
        if not is_false(x.nan):
            builder.numbers_in_memory[name] = (start, value, x)
        if shape is not None and shape.nan:
            builder.close_cell(f"{name}.nan", x.nan)
        builder.close_cell(name, x.value)

    return value, close


def enumerator(term: z3.ArithRef, of: Enum) -> ExtendedReal:
    """Return a number that is one of the members."""
    values = sorted({v for _, v in of.members})
    if len(values) == 1:
        return constant(values[0])
    return with_cases(term, tuple((v, cast(z3.BoolRef, term == constant(v).value)) for v in values))


def _number(
    builder: SystemBuilder, name: str, start: ExtendedReal
) -> tuple[Scalar, Callable[[Scalar], None]]:
    """Open the cells of a number: `nan` and `infinite` have cells only if its shape allows them."""
    shape = builder.shapes.get(name, shape_of(start))
    nan = infinite = FALSE
    if shape.nan:
        nan = cast(z3.BoolRef, builder.open_cell(f"{name}.nan", z3.BoolSort(), start.nan))
    if shape.infinite:
        infinite = cast(z3.BoolRef, builder.open_cell(f"{name}.infinite", z3.BoolSort(), start.infinite))
    if shape.bounds.whole:
        whole = cast(z3.ArithRef, builder.open_cell(name, z3.IntSort(), _whole(start)))
        old = ExtendedReal(z3.ToReal(whole), nan, infinite, shape.bounds, whole)
        term: z3.ArithRef = whole
    else:
        term = cast(z3.ArithRef, builder.open_cell(name, z3.RealSort(), start.value))
        old = ExtendedReal(term, nan, infinite, shape.bounds)
    builder.invariant(term, within(old, shape.bounds))
    if shape.infinite:
        builder.invariant(infinite, implied(both(infinite, negation(nan)), _signed(old)))

    def close(x: Scalar) -> None:
        assert isinstance(x, ExtendedReal)
        builder.numbers_in_memory[name] = (start, old, x)
        if shape.nan:
            builder.close_cell(f"{name}.nan", x.nan)
        if shape.infinite:
            builder.close_cell(f"{name}.infinite", x.infinite)
        whole = whole_of(x) if shape.bounds.whole else None
        builder.close_cell(name, x.value if whole is None else whole)

    return old, close


def _signed(x: ExtendedReal) -> z3.BoolRef:
    """Return the condition that an infinite number has a sign within its bounds."""
    up = FALSE if x.bounds.high is not None else cast(z3.BoolRef, x.value > 0)
    down = FALSE if x.bounds.low is not None else cast(z3.BoolRef, x.value < 0)
    return either(up, down)


def _whole(x: ExtendedReal) -> z3.ArithRef:
    term = whole_of(x)
    assert term is not None, f"{x} is not whole"
    return term


def shape_of(x: ExtendedReal) -> Shape:
    """Return the possible values of a number."""
    return Shape(not is_false(x.nan), not is_false(x.infinite), x.bounds)


def _known(x: Scalar) -> ScalarValue | None:
    """Return the value of a constant scalar, None for others."""
    if isinstance(x, ExtendedReal):
        return constant_of(x)
    return True if is_true(x) else False if is_false(x) else None
