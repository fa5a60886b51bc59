"""Reference evaluation: the value of an expression in a frame, and whether it reads something missing.

Evaluation is strict: every operand is evaluated, even in a branch not taken. So each memory function is
evaluated exactly once per key whenever its expression is evaluated. A key is (call, values of the enclosing
loop variables, element): each separate memory of the language is one entry of a dict here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar, assert_never, cast

from colony.ir import angles
from colony.ir import expression as ir
from colony.ir.bearings import Bearings, nearest
from colony.ir.expression import Binary, Function, Unary
from colony.ir.types import Array, ScalarValue, Value

# --- functions ----------------------------------------------------------------------------------------
#
# The pure functions and operators of the language on scalars, as the language reference defines them.
#
# Every executor must give these results bit for bit, the sign of zero included, so each definition says what
# happens at NaN, at infinities and at zeros. Nothing here raises on any float.

NAN = math.nan


def unary(operator: Unary, x: ScalarValue) -> ScalarValue:
    """Return `-x`, `not x`."""
    match operator:
        case Unary.NEGATE:
            return -x
        case Unary.NOT:
            return not x
        case _:
            assert_never(operator)


def binary(operator: Binary, x: ScalarValue, y: ScalarValue) -> ScalarValue:
    """Return `x operator y`; both operands have been evaluated, whatever the operator."""
    match operator:
        case Binary.ADD:
            return x + y
        case Binary.SUBTRACT:
            return x - y
        case Binary.MULTIPLY:
            return x * y
        case Binary.DIVIDE:
            return divide(x, y)
        case Binary.LESS:
            return x < y
        case Binary.LESS_EQUAL:
            return x <= y
        case Binary.GREATER:
            return x > y
        case Binary.GREATER_EQUAL:
            return x >= y
        case Binary.EQUAL:
            return x == y
        case Binary.NOT_EQUAL:
            return x != y
        case Binary.AND:
            return x and y
        case Binary.OR:
            return x or y
        case Binary.IMPLIES:
            return not x or y
        case _:
            assert_never(operator)


def function(f: Function, x: Sequence[ScalarValue]) -> ScalarValue:
    """Return the value of `f` for `x`: the values to reduce, or the arguments in order."""
    match f:
        case Function.MIN:
            return least(x)
        case Function.MAX:
            return greatest(x)
        case Function.SUM:
            return total(x)
        case Function.MEAN:
            return total(x) / len(x) if x else NAN
        case Function.COUNT:
            return float(len([v for v in x if v]))
        case Function.ANY:
            return any(x)
        case Function.ALL:
            return all(x)
        case Function.INDEX_OF_MIN:
            return float(first_index(x, lambda a, b: a < b))
        case Function.INDEX_OF_MAX:
            return float(first_index(x, lambda a, b: a > b))
        case Function.MOD:
            return modulo(x[0], x[1])
        case Function.CLAMP:
            return least((greatest((x[0], x[1])), x[2]))
        case Function.ATAN2:
            return angles.direction(x[0], x[1])
        case Function.ANGLE_DIFFERENCE:
            return angle_difference(x[0], x[1])
        case _:
            return unary_function(f, x[0])


def unary_function(f: Function, x: float) -> float:
    """Return the value of a function of one number."""
    match f:
        case Function.ABS:
            return abs(x)
        case Function.SIGN:
            return x if math.isnan(x) else 1.0 if x > 0 else -1.0 if x < 0 else 0.0
        case Function.SQRT:
            return NAN if x < 0 else math.sqrt(x)
        case Function.FLOOR:
            return whole(math.floor, x)
        case Function.CEIL:
            return whole(math.ceil, x)
        case Function.ROUND:
            return whole(round, x)
        case Function.SIN:
            return angles.sine(x)
        case Function.COS:
            return angles.cosine(x)
        case Function.TAN:
            return angles.tangent(x)
        case Function.ASIN:
            return angles.arc_sine(x)
        case Function.ACOS:
            return angles.arc_cosine(x)
        case _:
            raise AssertionError(f"{f} is not a function of one number")


def divide(x: float, y: float) -> float:
    """Divide by IEEE 754: a division by zero gives an infinity, or NaN for 0 / 0 and NaN / 0."""
    if y != 0:
        return x / y
    if x == 0 or math.isnan(x):
        return NAN
    return math.copysign(1.0, x) * math.copysign(1.0, y) * math.inf


def modulo(x: float, y: float) -> float:
    """Return the remainder with the sign of `y`; NaN for y = 0."""
    return NAN if y == 0 else x % y


def angle_difference(a: float, b: float) -> float:
    """Return the angle from `b` to `a` in degrees: above -180, up to 180."""
    d = modulo(a - b, 360.0)
    return d - 360.0 if d > 180.0 else d


def least(x: Sequence[float]) -> float:
    """Return the least value, the first among equals; NaN if any is NaN, or there is none."""
    if not x or any(math.isnan(v) for v in x):
        return NAN
    best = x[0]
    for v in x:
        if v < best:
            best = v
    return best


def greatest(x: Sequence[float]) -> float:
    """Return the greatest value, the first among equals; NaN if any is NaN, or there is none."""
    if not x or any(math.isnan(v) for v in x):
        return NAN
    best = x[0]
    for v in x:
        if v > best:
            best = v
    return best


def total(x: Sequence[float]) -> float:
    """Return the sum from left to right, starting with the first value (a lone -0.0 stays); 0 of nothing."""
    if not x:
        return 0.0
    result = x[0]
    for v in x[1:]:
        result = result + v
    return result


def first_index(x: Sequence[float], better: Callable[[float, float], bool]) -> int:
    """Return the index of the best value, the first among equals; numbers beat NaN; 0 if all are NaN."""
    best = 0
    for i, v in enumerate(x):
        if better(v, x[best]) or (math.isnan(x[best]) and not math.isnan(v)):
            best = i
    return best


def whole(rounding: Callable[[float], int], x: float) -> float:
    """Return `x` rounded; a zero result has the sign of `x`; NaN and infinities are unchanged."""
    return math.copysign(float(rounding(x)), x) if math.isfinite(x) else x


def position(index: float, size: int, wraps: bool) -> int | None:
    """Return an index rounded (halves to even) and, if it `wraps`, taken modulo the size.

    None if it is outside, or not finite.
    """
    if not math.isfinite(index):
        return None
    place = round(index) % size if wraps else round(index)
    return place if 0 <= place < size else None


def element_at(array: tuple[ScalarValue, ...], index: float, wraps: bool) -> ScalarValue:
    """Return the element at `index`, see `position`; outside it is NaN, or False of an array of bools."""
    place = position(index, len(array), wraps)
    if place is None:
        return False if isinstance(array[0], bool) else NAN
    return array[place]


# --- expressions --------------------------------------------------------------------------------------

T = TypeVar("T")

Remembered = float | bool | int | tuple[float | bool | int | None, ...] | None
"""The state of a memory function."""

Memory = dict[tuple[int, tuple[int, ...], int], Remembered]
"""State of the memory functions; an absent key is a call that was never evaluated (see `remember`)."""


class Round(NamedTuple):
    """A round of a reduction: its variable, the variable's value, and the elements of its arrays by name."""

    variable: str
    k: int
    elements: Mapping[str, Any]


Loop = tuple[Round, ...]
"""The present rounds of the enclosing reductions, outermost first."""


@dataclass(slots=True, kw_only=True)
class FrameValues:
    """The values of one frame, in base units. A name that a mapping lacks is missing.

    Mutable: filled in the order in which the frame is computed.
    """

    number: int  # of the frame, counted from 1 after memory was initial or restored
    t_ns: int
    first_ns: int
    states: Mapping[str, ScalarValue]  # old values, by `name` or `module.name`; machines too
    restarted: bool = False
    sensors: dict[str, Value] = field(default_factory=dict)
    fresh: set[str] = field(default_factory=set)  # sensors with a reading, not a default
    derived: dict[str, Value] = field(default_factory=dict)
    locals: dict[str, Value] = field(default_factory=dict)
    commands: dict[str, tuple[ScalarValue, ...]] = field(default_factory=dict)  # of active modules
    outputs: dict[str, str | None] = field(
        default_factory=dict
    )  # by module or wire: the module whose command is on it
    winners: dict[str, str | None] = field(default_factory=dict)  # by actuator
    commanded: set[str] = field(default_factory=set)  # actuators that were sent a module's command
    sent: dict[tuple[str, int], ScalarValue] = field(default_factory=dict)  # actuator and field


def missing(e: ir.Expression, frame_values: FrameValues, own: Set[str] = frozenset()) -> bool:
    """Return True if something that `e` needs is missing; `own` are lets that count as present."""
    match e:
        case ir.SensorValue(name=name):
            return name not in frame_values.sensors
        case ir.DerivedValue(name=name):
            return name not in frame_values.derived
        case ir.LocalValue(name=name):
            return name not in frame_values.locals and name not in own
        case ir.SentField(actuator=actuator, field_index=i):
            return (actuator, i) not in frame_values.sent
        case ir.ValueOr(other=other):
            return missing(other, frame_values, own)
        case _:
            return any(missing(child, frame_values, own) for child in ir.children(e))


def evaluate(e: ir.Expression, frame_values: FrameValues, memory: Memory, loop: Loop = ()) -> Value:
    """Return the value of `e`, which must read nothing missing, and advance its memory."""

    def value(operand: ir.Expression) -> Value:
        return evaluate(operand, frame_values, memory, loop)

    match e:
        case ir.UnaryOperation(operand=operand):
            return each(lambda x: unary(e.operator, x), value(operand))
        case ir.BinaryOperation(left=left, right=right):
            return each(lambda x, y: binary(e.operator, x, y), value(left), value(right))
        case ir.Conditional(condition=condition, yes=yes, no=no):
            truth = value(condition)
            return each(lambda x, y: x if truth else y, value(yes), value(no))
        case ir.Within(operand=operand, low=low, high=high):
            return each(lambda x, a, b: a <= x <= b, value(operand), value(low), value(high))
        case ir.Nearest(bearings=bearings, angle=angle):
            return index_of_bearing(bearings, scalar(value(angle)))
        case ir.Element() | ir.Slice() | ir.Window():
            return array_access(e, elements(value(e.array)), value)
        case ir.ValueOr():
            return value_or(e, value, is_missing=missing(e.expression, frame_values))
        case ir.FunctionCall():
            return call(e, frame_values, memory, loop)
        case ir.Reduce():
            return reduce(e, frame_values, memory, loop)
        case ir.LoopElement():
            return cast("ScalarValue", loop_element(e, loop))
        case ir.MemoryCall():
            return recall(e, [value(a) for a in e.arguments], frame_values, memory, loop)
        case _:
            return leaf(e, frame_values, loop)


def leaf(e: ir.Expression, frame_values: FrameValues, loop: Loop) -> Value:
    """Return the value of an expression without operands."""
    match e:
        case ir.Constant(value=value):
            return value
        case ir.SensorValue(name=name):
            return frame_values.sensors[name]
        case ir.DerivedValue(name=name):
            return frame_values.derived[name]
        case ir.LocalValue(name=name):
            return frame_values.locals[name]
        case ir.StateValue(name=name):
            return frame_values.states[name]
        case ir.LoopIndex(name=name):
            return float([turn.k for turn in loop if turn.variable == name][-1])
        case ir.Now() | ir.RestartedFlag():
            now = (frame_values.t_ns - frame_values.first_ns) / 1e9
            return now if isinstance(e, ir.Now) else frame_values.restarted
        case ir.Fresh(name=name, derived=derived):
            return name in frame_values.derived if derived else name in frame_values.fresh
        case ir.SentField(actuator=actuator, field_index=i):
            return frame_values.sent[actuator, i]
        case ir.WonBy(actuator=actuator, module=module):
            return frame_values.winners[actuator] == module
        case ir.IsCommanded(actuator=actuator):
            return actuator in frame_values.commanded
        case ir.IsIdle(actuator=actuator):
            return actuator not in frame_values.commanded
        case ir.IsActive(name=name):
            return frame_values.outputs[name] is not None
        case _:
            raise AssertionError(f"{type(e).__name__} has operands")


# --- arrays --------------------------------------------------------------------------------------


Evaluate = Callable[[ir.Expression], Value]


def array_access(
    e: ir.Element | ir.Slice | ir.Window, whole: tuple[ScalarValue, ...], value: Evaluate
) -> Value:
    """Return an element or some elements of an array."""
    match e:
        case ir.Element(index=index):
            return element_at(whole, scalar(value(index)), e.wraps)
        case ir.Slice(indices=indices):
            return tuple(whole[i] for i in indices)
        case ir.Window(center=center):
            return tuple(element_at(whole, i, e.wraps) for i in window_indices(e, scalar(value(center))))


def value_or(e: ir.ValueOr, value: Evaluate, *, is_missing: bool) -> Value:
    """Return the first value; the second where the first is missing, or is an element that is outside."""
    first: Value | None = None
    if isinstance(e.expression, ir.Element) and not is_missing:
        array, index = elements(value(e.expression.array)), scalar(value(e.expression.index))
        place = position(index, len(array), e.expression.wraps)
        first = None if place is None else array[place]
    elif not is_missing:
        first = value(e.expression)
    second = value(e.other)
    return broadcast(second if first is None else first, e)


def each(f: Callable[..., T], *operands: T | tuple[T, ...]) -> T | tuple[T, ...]:
    """Apply `f` element by element where an operand is an array; a scalar stands for all elements."""
    sizes = [len(x) for x in operands if isinstance(x, tuple)]
    if not sizes:
        return f(*operands)
    return tuple(f(*(x[i] if isinstance(x, tuple) else x for x in operands)) for i in range(sizes[0]))


def broadcast(value: Value, e: ir.Expression) -> Value:
    """Return `value`, repeated for each element if `e` is an array and `value` a scalar."""
    if isinstance(e.type, Array) and not isinstance(value, tuple):
        return (value,) * e.type.size
    return value


def elements(value: Value) -> tuple[ScalarValue, ...]:
    """Return the elements of an array's value."""
    assert isinstance(value, tuple)
    return value


def scalar(value: Value) -> ScalarValue:
    """Return a value that is a scalar."""
    assert not isinstance(value, tuple)
    return value


def index_of_bearing(bearings: Bearings, angle: float) -> float:
    """Return the index of the element nearest to an angle, NaN where that is outside or not finite."""
    index = nearest(bearings, angle)
    return NAN if index is None else float(index)


def window_indices(e: ir.Window, center: float) -> list[float]:
    """Return the indices of a window's elements, in order; NaN for one that is outside."""
    if not math.isfinite(center):
        return [NAN] * (2 * e.reach + 1)
    places = [position(round(center) + j, len_of(e.array), e.wraps) for j in range(-e.reach, e.reach + 1)]
    return [NAN if place is None else float(place) for place in places]


def len_of(e: ir.Expression) -> int:
    """Return the number of elements of an array."""
    assert isinstance(e.type, Array)
    return e.type.size


# --- functions -----------------------------------------------------------------------------------


def call(e: ir.FunctionCall, frame_values: FrameValues, memory: Memory, loop: Loop) -> Value:
    """Evaluate a pure function of an array, of several scalars, or element by element."""
    if e.function in ir.INDEX_FUNCTIONS:
        return index_function(e.function, e.arguments[0], frame_values, memory, loop)
    arguments = [evaluate(a, frame_values, memory, loop) for a in e.arguments]
    if e.function in ir.REDUCTIONS:
        return function(e.function, [x for a in arguments for x in (a if isinstance(a, tuple) else (a,))])
    return each(lambda *x: function(e.function, x), *arguments)


def index_function(
    f: ir.Function, e: ir.Expression, frame_values: FrameValues, memory: Memory, loop: Loop
) -> float:
    """Return the index of the least or greatest element; for a slice or window, in the whole array."""
    match e:
        case ir.Slice(array=array, indices=indices):
            whole = elements(evaluate(array, frame_values, memory, loop))
            return float(indices[int(function(f, [whole[i] for i in indices]))])
        case ir.Window(array=array, center=center):
            whole = elements(evaluate(array, frame_values, memory, loop))
            chosen = window_indices(e, scalar(evaluate(center, frame_values, memory, loop)))
            return chosen[int(function(f, [element_at(whole, i, e.wraps) for i in chosen]))]
        case _:
            return function(f, elements(evaluate(e, frame_values, memory, loop)))


def reduce(e: ir.Reduce, frame_values: FrameValues, memory: Memory, loop: Loop) -> ScalarValue:
    """Evaluate a reduction: its body and condition for each value of its variable."""
    included = []
    arrays = {name: elements(evaluate(array, frame_values, memory, loop)) for name, array in e.arrays}
    for k in range(e.low, e.high + 1):
        inner = (*loop, Round(e.variable, k, {name: array[k] for name, array in arrays.items()}))
        body = scalar(evaluate(e.body, frame_values, memory, inner))
        if e.condition is None or evaluate(e.condition, frame_values, memory, inner):
            included.append(body)
    return function(e.function, included)


def loop_element(e: ir.LoopElement, loop: Loop) -> Any:
    """Return the present element of an array of an enclosing reduction."""
    return [turn.elements[e.name] for turn in loop if e.name in turn.elements][-1]


# --- memory --------------------------------------------------------------------------------------


def recall(
    e: ir.MemoryCall, arguments: list[Value], frame_values: FrameValues, memory: Memory, loop: Loop
) -> Value:
    """Evaluate a memory function; each element of an array and each loop index has its own memory."""
    path = tuple(turn.k for turn in loop)
    sizes = [len(a) for a in arguments if isinstance(a, tuple)]
    results = []
    for i in range(sizes[0] if sizes else 1):
        x = [a[i] if isinstance(a, tuple) else a for a in arguments]
        key = (e.cell, path, i)
        result, memory[key] = remember(e, x, memory.get(key), frame_values)
        results.append(result)
    return tuple(results) if sizes else results[0]


def remember(
    e: ir.MemoryCall, x: list[ScalarValue], last: Any, frame_values: FrameValues
) -> tuple[ScalarValue, Any]:
    """Return the value of a memory function and its new state; `last` is the old state, None at first."""
    t_ns = frame_values.t_ns
    match e.function:
        case ir.MemoryFunction.PREVIOUS:
            return (x[1] if last is None else last), x[0]
        case ir.MemoryFunction.CHANGED:
            return last is not None and x[0] != last, x[0]
        case ir.MemoryFunction.RISING:
            return bool(x[0] and not last), x[0]
        case ir.MemoryFunction.FALLING:
            return bool(not x[0] and last), x[0]
        case ir.MemoryFunction.RECENTLY:  # remembers the last time at which b was true
            seen = t_ns if x[0] else last
            return bool(x[0]) or (seen is not None and t_ns - seen < e.duration_ns), seen
        case ir.MemoryFunction.SUSTAINED:  # remembers since when b is true, and the last frame of that
            unbroken = last is not None and last[1] == frame_values.number - 1
            since = None if not x[0] else last[0] if unbroken else t_ns
            return since is not None and t_ns - since >= e.duration_ns, (
                None if since is None else (since, frame_values.number)
            )
        case ir.MemoryFunction.ELAPSED:  # remembers when b became true, None while it is false
            since = None if not x[0] else t_ns if last is None else last
            return (0.0 if since is None else (t_ns - since) / 1e9), since
        case ir.MemoryFunction.LATCH:
            latched = bool((last or x[0]) and not x[1])
            return latched, latched
        case ir.MemoryFunction.CAPTURED:  # remembers the captured value, and the key of the last frame
            captured = last[0] if last is not None and last[1] == x[1] else x[0]
            return captured, (captured, x[1])
        case ir.MemoryFunction.EVERY:  # remembers when it was last true
            due = last is None or t_ns >= last + e.duration_ns
            return due, (t_ns if due else last)
        case _:
            assert_never(e.function)
