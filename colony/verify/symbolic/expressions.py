"""Encoding of expressions as terms; their memory advances where they are evaluated.

Evaluation is strict, as in the interpreter: every operand is evaluated wherever its expression is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import z3

from colony.ir import expression as ir
from colony.ir.types import Array, ScalarValue, element_type
from colony.verify.symbolic.arithmetic import Arithmetic, nearest
from colony.verify.symbolic.builder import SymbolicValues, SystemBuilder, evaluation_condition, missing
from colony.verify.symbolic.cases import by_cases, constant, whole_of
from colony.verify.symbolic.functions import (
    apply,
    binary,
    boolean,
    extreme_at,
    index_of,
    number,
    reduction,
    unary,
)
from colony.verify.symbolic.logic import FALSE, TRUE, any_of, both, either, is_false, negation, truth
from colony.verify.symbolic.memory import recall, seconds
from colony.verify.symbolic.numbers import compared, finite, select
from colony.verify.symbolic.system import ExtendedReal, Scalar, Term


@dataclass(frozen=True, slots=True)
class SymbolicRound:
    """A round of a reduction: its variable, the variable's value, and the elements of its arrays by name."""

    variable: str
    k: int
    elements: Mapping[str, Any]


Loop = tuple[SymbolicRound, ...]
"""The present rounds of the enclosing reductions, outermost first."""


@dataclass(frozen=True, slots=True)
class Positions:
    """The conditions under which an index, rounded, selects elements of an array of `size`.

    `places` are the whole numbers that it may be, modulo the size if it `wraps`, each with its condition.
    Without wrapping, `span` has its bounds, if they are known.
    """

    size: int
    wraps: bool
    is_finite: z3.BoolRef
    places: tuple[tuple[int, z3.BoolRef], ...]
    span: tuple[int, int] | None = None

    def at(self, offset: int) -> list[tuple[int, z3.BoolRef]]:
        """Return the elements that the index can select when `offset` is added, each with its condition."""
        moved = [(n + offset, condition) for n, condition in self.places if not is_false(condition)]
        if self.wraps:
            return [(n % self.size, condition) for n, condition in moved]
        return [(n, condition) for n, condition in moved if 0 <= n < self.size]

    def is_inside(self, offset: int) -> z3.BoolRef:
        """Return the condition that the index selects an element when `offset` is added."""
        if self.wraps:
            return self.is_finite
        if self.span is not None and self.span[0] + offset >= 0 and self.span[1] + offset < self.size:
            return self.is_finite
        return any_of(condition for _, condition in self.at(offset))


def constant_term(value: ScalarValue) -> Scalar:
    """Return a value of the language as a constant term."""
    return truth(value) if isinstance(value, bool) else constant(value)


def each(operation: Callable[..., Scalar], *operands: Term) -> Term:
    """Apply `operation` element by element where an operand is an array; a scalar stands for all elements."""
    sizes = [len(x) for x in operands if isinstance(x, tuple)]
    if not sizes:
        return operation(*operands)
    return tuple(operation(*(x[i] if isinstance(x, tuple) else x for x in operands)) for i in range(sizes[0]))


def scalar(value: Term) -> Scalar:
    """Return a term that is a scalar."""
    assert not isinstance(value, tuple)
    return value


def elements(value: Term) -> tuple[Scalar, ...]:
    """Return the elements of an array's term."""
    assert isinstance(value, tuple)
    return value


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpressionEncoder:
    """Encodes expressions of one owner, whose memory advances where `advances` holds.

    `own_lets` are the owner's lets, which are never missing when the owner is evaluated. `hint` is the prefix
    for the names of its memory cells.
    """

    builder: SystemBuilder
    frame_values: SymbolicValues
    advances: z3.BoolRef
    hint: str
    own_lets: frozenset[str] = frozenset()
    loop: Loop = ()

    def scalar(self, e: ir.Expression) -> Scalar:
        """Return the term of a scalar expression."""
        return scalar(self.value(e))

    def number(self, e: ir.Expression) -> ExtendedReal:
        """Return the term of a number."""
        return number(self.scalar(e))

    def boolean(self, e: ir.Expression) -> z3.BoolRef:
        """Return the term of a condition."""
        return boolean(self.scalar(e))

    def value(self, e: ir.Expression) -> Term:
        """Return the value of `e`; it is arbitrary where `e` reads something missing."""
        arithmetic = Arithmetic(self.builder, e.span)
        match e:
            case ir.UnaryOperation(operator=operator, operand=operand):
                return each(lambda x: unary(operator, x), self.value(operand))
            case ir.BinaryOperation(operator=operator_, left=left, right=right):
                return each(
                    lambda x, y: binary(operator_, x, y, arithmetic), self.value(left), self.value(right)
                )
            case ir.Conditional(condition=condition, yes=yes, no=no):
                condition_term = self.boolean(condition)
                return each(lambda x, y: select(condition_term, x, y), self.value(yes), self.value(no))
            case ir.Within(operand=operand, low=low, high=high):
                return each(within, self.value(operand), self.value(low), self.value(high))
            case ir.Nearest():
                return nearest(self.number(e.angle), e.bearings, arithmetic)
            case ir.Element() | ir.Slice() | ir.Window():
                return self._array_access(e)
            case ir.ValueOr():
                return self._value_or(e)
            case ir.FunctionCall():
                return self._call(e, arithmetic)
            case ir.Reduce():
                return self._reduce(e, arithmetic)
            case ir.MemoryCall():
                return self._memory(e)
            case _:
                return self._leaf(e)

    def _leaf(self, e: ir.Expression) -> Term:
        frame_values = self.frame_values
        match e:
            case ir.Constant(value=value):
                return tuple(map(constant_term, value)) if isinstance(value, tuple) else constant_term(value)
            case ir.SensorValue(name=name):
                return frame_values.sensors[name]
            case ir.DerivedValue(name=name):
                return frame_values.derived[name][1]
            case ir.LocalValue(name=name):
                return frame_values.locals[name][1]
            case ir.StateValue(name=name):
                return frame_values.states[name]
            case ir.LoopIndex(name=name) | ir.LoopElement(name=name):
                is_index = isinstance(e, ir.LoopIndex)
                return constant(float(self.index(name))) if is_index else cast("Scalar", self.element(name))
            case ir.Now() | ir.RestartedFlag():
                is_now = isinstance(e, ir.Now)
                return seconds(frame_values.now, self.builder, e.span) if is_now else frame_values.restarted
            case ir.Fresh(name=name, derived=derived):
                return negation(frame_values.derived[name][0]) if derived else frame_values.present[name]
            case ir.SentField(actuator=actuator, field_index=i):
                return frame_values.sent[actuator, i][1]
            case ir.WonBy(actuator=actuator, module=module):
                return frame_values.wins[actuator].get(module, FALSE)
            case ir.IsCommanded(actuator=actuator):
                return frame_values.commanded[actuator]
            case ir.IsIdle(actuator=actuator):
                return negation(frame_values.commanded[actuator])
            case ir.IsActive(name=name):
                return frame_values.active[name]
            case _:
                raise AssertionError(f"{type(e).__name__} has operands")

    def _memory(self, e: ir.MemoryCall) -> Term:
        types = [element_type(a.type) for a in e.arguments]

        def recall_scalar(*x: Scalar) -> Scalar:
            return recall(e, x, types, self.builder, self.frame_values, self.advances, self.hint)

        return each(recall_scalar, *(self.value(a) for a in e.arguments))

    def _value_or(self, e: ir.ValueOr) -> Term:
        absent = missing(e.expression, self.frame_values, self.own_lets)
        inner = replace(
            self, advances=evaluation_condition(self.advances, e.expression, self.frame_values, self.own_lets)
        )
        if isinstance(e.expression, ir.Element):
            array, index = elements(inner.value(e.expression.array)), e.expression.index
            positions = inner._positions(index, len(array), e.expression)
            absent = either(absent, negation(positions.is_inside(0)))
            return select(absent, self.scalar(e.other), element_of(array, positions, 0))
        first, second = _broadcast(inner.value(e.expression), e), _broadcast(self.value(e.other), e)
        return each(lambda x, y: select(absent, y, x), first, second)

    def index(self, name: str) -> int:
        """Return the present value of the variable of an enclosing reduction."""
        return [turn.k for turn in self.loop if turn.variable == name][-1]

    def element(self, name: str) -> Any:
        """Return the present element of an array of an enclosing reduction."""
        return [turn.elements[name] for turn in self.loop if name in turn.elements][-1]

    # --- parts of arrays -------------------------------------------------------------------------

    def _array_access(self, e: ir.Element | ir.Slice | ir.Window) -> Term:
        array = elements(self.value(e.array))
        match e:
            case ir.Slice(indices=indices):
                return tuple(array[i] for i in indices)
            case ir.Element(index=index):
                x = self.number(index)
                best = extreme_at(array, x, self.builder)
                return element_of(array, self.positions(x, index, len(array), e), 0) if best is None else best
            case ir.Window(center=center, reach=reach):
                positions = self._positions(center, len(array), e)
                return tuple(element_of(array, positions, j) for j in range(-reach, reach + 1))

    def _positions(self, index: ir.Expression, size: int, e: ir.Element | ir.Window) -> Positions:
        return self.positions(self.number(index), index, size, e)

    def positions(
        self, x: ExtendedReal, index: ir.Expression, size: int, e: ir.Element | ir.Window
    ) -> Positions:
        """Return the conditions under which an index of value `x` selects each element of an array."""
        builder, reach = self.builder, e.reach if isinstance(e, ir.Window) else 0
        return builder.once(
            ("positions", builder.key(x), size, reach, e.wraps),
            lambda: self._compute_positions(x, index, size, None if e.wraps else reach),
        )

    def _compute_positions(
        self, x: ExtendedReal, index: ir.Expression, size: int, reach: int | None
    ) -> Positions:
        """Return the positions of an index; `reach` is how far outside it may be, None if it wraps."""
        is_finite, wraps = finite(x), reach is None
        outer = range(size) if reach is None else range(-reach, size + reach)

        def positions(places: Iterable[tuple[int, z3.BoolRef]], low: int, high: int) -> Positions:
            kept = tuple((n, both(is_finite, condition)) for n, condition in places)
            return Positions(size, wraps, is_finite, kept, None if wraps else (low, high))

        if not x.cases:
            x = Arithmetic(self.builder, index.span).round_of(replace(x, nan=FALSE, infinite=FALSE))
        if x.cases:
            by_place: dict[int, list[z3.BoolRef]] = {n: [] for n in outer}
            values = [(round(v), condition) for v, condition in x.cases if math.isfinite(v)]
            for n, condition in values:
                by_place.get(n % size if wraps else n, []).append(condition)
            places = [(n, any_of(conditions)) for n, conditions in by_place.items()]
            span = [n for n, _ in values] or [0]
            return positions(places, min(span), max(span))
        whole, low, high = whole_of(x), x.bounds.low, x.bounds.high
        assert whole is not None
        if wraps and (low is None or high is None or high - low > 4 * size):
            return positions([(k, cast(z3.BoolRef, whole % size == k)) for k in outer], 0, 0)
        first, last = (
            outer[0] - 1 if low is None else math.ceil(low),
            size * 2 if high is None else math.floor(high),
        )
        if wraps:
            equal = [(n, cast(z3.BoolRef, whole == n)) for n in range(first, last + 1)]
            return positions([(k, any_of(c for n, c in equal if n % size == k)) for k in outer], first, last)
        reached = [n for n in outer if first <= n <= last]
        return positions([(n, cast(z3.BoolRef, whole == n)) for n in reached], first, last)

    # --- functions -------------------------------------------------------------------------------

    def _call(self, e: ir.FunctionCall, arithmetic: Arithmetic) -> Term:
        if e.function in ir.INDEX_FUNCTIONS:
            return self._index_function(e.function, e.arguments[0], arithmetic)
        values = [self.value(a) for a in e.arguments]
        if e.function in ir.REDUCTIONS:
            flat = [x for v in values for x in (v if isinstance(v, tuple) else (v,))]
            return apply(e.function, flat, arithmetic)
        return each(lambda *x: apply(e.function, x, arithmetic), *values)

    def _index_function(
        self, function: ir.Function, e: ir.Expression, arithmetic: Arithmetic
    ) -> ExtendedReal:
        """Return the index of the least or greatest element; for a slice or window, in the whole array."""
        match e:
            case ir.Slice(indices=sliced):
                values, indices = elements(self.value(e)), [constant(float(i)) for i in sliced]
            case ir.Window(array=array, center=center, reach=reach):
                values, size = elements(self.value(e)), size_of(array)
                positions = self._positions(center, size, e)
                indices = [index_at(positions, j) for j in range(-reach, reach + 1)]
            case _:
                values = elements(self.value(e))
                indices = [constant(float(i)) for i in range(len(values))]
        return index_of(function, [number(x) for x in values], indices, arithmetic)

    def _reduce(self, e: ir.Reduce, arithmetic: Arithmetic) -> Scalar:
        items = []
        arrays = {name: elements(self.value(array)) for name, array in e.arrays}
        for k in range(e.low, e.high + 1):
            turn = SymbolicRound(e.variable, k, {name: array[k] for name, array in arrays.items()})
            inner = replace(self, loop=(*self.loop, turn))
            body = inner.scalar(e.body)
            items.append((body, TRUE if e.condition is None else inner.boolean(e.condition)))
        return reduction(e.function, items, arithmetic)


def within(x: Scalar, low: Scalar, high: Scalar) -> z3.BoolRef:
    """Return `x in low .. high`."""
    return both(compared(number(low), number(x), "<="), compared(number(x), number(high), "<="))


def _broadcast(value: Term, e: ir.Expression) -> Term:
    """Return `value`, repeated where `e` is an array and the value a scalar."""
    if isinstance(e.type, Array) and not isinstance(value, tuple):
        return (value,) * e.type.size
    return value


def size_of(e: ir.Expression) -> int:
    """Return the number of elements of an array."""
    assert isinstance(e.type, Array)
    return e.type.size


def element_of(array: Sequence[Scalar], positions: Positions, offset: int) -> Scalar:
    """Return the element `offset` after the selected one; NaN or false if there is none."""
    undefined: Scalar = constant(math.nan) if isinstance(array[0], ExtendedReal) else FALSE
    result: Scalar | None = None
    for k, selected in positions.at(offset):
        result = array[k] if result is None else select(selected, array[k], result)
    return undefined if result is None else select(positions.is_inside(offset), result, undefined)


def index_at(positions: Positions, offset: int) -> ExtendedReal:
    """Return the index `offset` after the selected one; NaN if it is outside, or not finite."""
    cases = [(float(k), selected) for k, selected in positions.at(offset)]
    return by_cases([*cases, (math.nan, negation(positions.is_inside(offset)))])
