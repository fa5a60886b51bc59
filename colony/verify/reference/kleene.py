"""Evaluation of contracts and expectations in Kleene's three-valued logic: true, false, or unknown.

What reads something missing is unknown. `false and u` is false, `true or u` is true, and `if` counts the
branch that is chosen; an operation or function of anything unknown is unknown otherwise. Evaluation is
strict, as elsewhere: every operand is evaluated, and the memory of a call moves on in each frame in which its
own arguments are known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TypeGuard, cast

from colony.ir import expression as ir
from colony.ir.types import Array, ScalarValue, Value
from colony.verify.reference.expressions import (
    FrameValues,
    Loop,
    Memory,
    Round,
    binary,
    each,
    function,
    index_of_bearing,
    leaf,
    loop_element,
    position,
    remember,
    unary,
    window_indices,
)

Scalar = ScalarValue | None
"""A scalar, or None: unknown."""
Known = Scalar | tuple[Scalar, ...]
"""A scalar or an array; each element of an array may be unknown."""


def known_value(e: ir.Expression, frame_values: FrameValues, memory: Memory, loop: Loop = ()) -> Known:
    """Return the value of `e`, as far as it is known, and advance its memory."""

    def value(operand: ir.Expression) -> Known:
        return known_value(operand, frame_values, memory, loop)

    match e:
        case ir.UnaryOperation(operand=operand):
            return each(partial(strict, partial(unary, e.operator)), value(operand))
        case ir.BinaryOperation(left=left, right=right):
            return each(partial(operation, e.operator), value(left), value(right))
        case ir.Conditional(condition=condition, yes=yes, no=no):
            return each(choice, value(condition), value(yes), value(no))
        case ir.Within(operand=operand, low=low, high=high):
            return each(partial(strict, within), value(operand), value(low), value(high))
        case ir.Nearest(angle=angle):
            return strict(partial(index_of_bearing, e.bearings), scalar(value(angle)))
        case ir.Element() | ir.Slice() | ir.Window():
            return array_access(e, frame_values, memory, loop)
        case ir.ValueOr(expression=expression, other=other):
            return each(lambda x, y: y if x is None else x, shaped(value(expression), e), value(other))
        case ir.FunctionCall():
            return call(e, frame_values, memory, loop)
        case ir.Reduce():
            return reduce(e, frame_values, memory, loop)
        case ir.LoopElement():
            return cast("Scalar", loop_element(e, loop))
        case ir.MemoryCall():
            return recall(e, [value(a) for a in e.arguments], frame_values, memory, loop)
        case _:
            return shaped(leaf(e, frame_values, loop) if is_there(e, frame_values) else None, e)


def is_there(e: ir.Expression, frame_values: FrameValues) -> bool:
    """Return True unless `e`, which has no operands, is missing."""
    match e:
        case ir.SensorValue(name=name):
            return name in frame_values.sensors
        case ir.DerivedValue(name=name):
            return name in frame_values.derived
        case ir.LocalValue(name=name):
            return name in frame_values.locals
        case ir.SentField(actuator=actuator, field_index=i):
            return (actuator, i) in frame_values.sent
        case _:
            return True


def is_known(value: Known) -> TypeGuard[Value]:
    """Return True if no part of the value is unknown."""
    return None not in value if isinstance(value, tuple) else value is not None


# --- logic ---------------------------------------------------------------------------------------


def negation(x: Scalar) -> Scalar:
    """Return `not x`."""
    return None if x is None else not x


def all_of(operands: Iterable[Scalar]) -> Scalar:
    """Return the conjunction: false if an operand is, else unknown if one is."""
    found = list(operands)
    if any(x is False for x in found):
        return False
    return None if any(x is None for x in found) else True


def any_of(operands: Iterable[Scalar]) -> Scalar:
    """Return the disjunction: true if an operand is, else unknown if one is."""
    found = list(operands)
    if any(x is True for x in found):
        return True
    return None if any(x is None for x in found) else False


def strict(f: Callable[..., ScalarValue], *x: Scalar) -> Scalar:
    """Return `f` of the arguments, unknown if one of them is."""
    return None if any(v is None for v in x) else f(*x)


def operation(operator: ir.Binary, x: Scalar, y: Scalar) -> Scalar:
    """Return `x operator y`: `A implies B` is `not A or B`."""
    match operator:
        case ir.Binary.AND:
            return all_of((x, y))
        case ir.Binary.OR:
            return any_of((x, y))
        case ir.Binary.IMPLIES:
            return any_of((negation(x), y))
        case _:
            return strict(partial(binary, operator), x, y)


def choice(condition: Scalar, yes: Scalar, no: Scalar) -> Scalar:
    """Return the branch that is chosen, unknown if the condition is."""
    return None if condition is None else yes if condition else no


def within(x: float, low: float, high: float) -> bool:
    """Return `x in low .. high`."""
    return low <= x <= high


# --- arrays --------------------------------------------------------------------------------------


def array_access(
    e: ir.Element | ir.Slice | ir.Window, frame_values: FrameValues, memory: Memory, loop: Loop
) -> Known:
    """Return an element or some elements of an array."""
    whole = elements(known_value(e.array, frame_values, memory, loop))
    match e:
        case ir.Element(index=index):
            return element(whole, scalar(known_value(index, frame_values, memory, loop)), e.wraps)
        case ir.Slice(indices=indices):
            return tuple(whole[i] for i in indices)
        case ir.Window(center=center):
            middle = scalar(known_value(center, frame_values, memory, loop))
            return tuple(element(whole, i, e.wraps) for i in indices_of_window(e, middle))


def shaped(value: Known | Value, e: ir.Expression) -> Known:
    """Return `value`, repeated for each element if `e` is an array and `value` a scalar."""
    if isinstance(e.type, Array) and not isinstance(value, tuple):
        return (value,) * e.type.size
    return value


def elements(value: Known) -> tuple[Scalar, ...]:
    """Return the elements of an array."""
    assert isinstance(value, tuple)
    return value


def scalar(value: Known) -> Scalar:
    """Return a value that is a scalar."""
    assert not isinstance(value, tuple)
    return value


def element(whole: tuple[Scalar, ...], index: Scalar, wraps: bool) -> Scalar:
    """Return the element at `index` (see `functions.position`), unknown if it is outside, or the index is."""
    place = None if index is None else position(index, len(whole), wraps)
    return None if place is None else whole[place]


def indices_of_window(e: ir.Window, center: Scalar) -> list[Scalar]:
    """Return the indices of a window's elements, in order, unknown if the center is."""
    return [None] * (2 * e.reach + 1) if center is None else [*window_indices(e, center)]


# --- functions -----------------------------------------------------------------------------------


def call(e: ir.FunctionCall, frame_values: FrameValues, memory: Memory, loop: Loop) -> Known:
    """Evaluate a pure function of an array, of several scalars, or element by element."""
    if e.function in ir.INDEX_FUNCTIONS:
        return index_function(e.function, e.arguments[0], frame_values, memory, loop)
    arguments = [known_value(a, frame_values, memory, loop) for a in e.arguments]
    if e.function in ir.REDUCTIONS:
        return reduction(e.function, [x for a in arguments for x in (a if isinstance(a, tuple) else (a,))])
    return each(lambda *x: strict(lambda *known: function(e.function, known), *x), *arguments)


def reduction(f: ir.Function, operands: Sequence[Scalar]) -> Scalar:
    """Return `any` and `all` as `or` and `and`; any other reduction is unknown if an operand is."""
    match f:
        case ir.Function.ANY:
            return any_of(operands)
        case ir.Function.ALL:
            return all_of(operands)
        case _:
            return strict(lambda *known: function(f, known), *operands)


def index_function(
    f: ir.Function, e: ir.Expression, frame_values: FrameValues, memory: Memory, loop: Loop
) -> Scalar:
    """Return the index of the least or greatest element; for a slice or window, in the whole array."""

    def value(operand: ir.Expression) -> Known:
        return known_value(operand, frame_values, memory, loop)

    match e:
        case ir.Slice(array=array, indices=indices):
            whole = elements(value(array))
            best = reduction(f, [whole[i] for i in indices])
            return None if best is None else float(indices[int(best)])
        case ir.Window(array=array, center=center):
            whole, chosen = elements(value(array)), indices_of_window(e, scalar(value(center)))
            best = reduction(f, [element(whole, i, e.wraps) for i in chosen])
            return None if best is None else chosen[int(best)]
        case _:
            return reduction(f, elements(value(e)))


def reduce(e: ir.Reduce, frame_values: FrameValues, memory: Memory, loop: Loop) -> Scalar:
    """Evaluate a reduction: `any(E if C)` as `any(C and E)`, `all(E if C)` as `all(C implies E)`.

    Any other is unknown if one of its bodies or conditions is.
    """
    items: list[tuple[Scalar, Scalar]] = []
    arrays = {name: elements(known_value(array, frame_values, memory, loop)) for name, array in e.arrays}
    for k in range(e.low, e.high + 1):
        inner = (*loop, Round(e.variable, k, {name: array[k] for name, array in arrays.items()}))
        body = scalar(known_value(e.body, frame_values, memory, inner))
        condition: Scalar = True
        if e.condition is not None:
            condition = scalar(known_value(e.condition, frame_values, memory, inner))
        items.append((condition, body))
    match e.function:
        case ir.Function.ANY:
            return any_of(all_of(item) for item in items)
        case ir.Function.ALL:
            return all_of(any_of((negation(condition), body)) for condition, body in items)
        case _:
            if any(None in item for item in items):
                return None
            return function(e.function, [body for condition, body in items if condition and body is not None])


# --- memory --------------------------------------------------------------------------------------


def recall(
    e: ir.MemoryCall, arguments: list[Known], frame_values: FrameValues, memory: Memory, loop: Loop
) -> Known:
    """Evaluate a memory function, unknown and unchanged where an argument is unknown, element by element."""
    path = tuple(turn.k for turn in loop)
    sizes = [len(a) for a in arguments if isinstance(a, tuple)]
    results: list[Scalar] = []
    for i in range(sizes[0] if sizes else 1):
        x = [a[i] if isinstance(a, tuple) else a for a in arguments]
        known = [v for v in x if v is not None]
        key = (e.cell, path, i)
        result: Scalar = None
        if len(known) == len(x):
            result, memory[key] = remember(e, known, memory.get(key), frame_values)
        results.append(result)
    return tuple(results) if sizes else results[0]
