"""Typed expressions: names resolved, quantities in base units (mm, s, deg, A, V, degC), overloads resolved.

An expression is a tree of frozen nodes, each with its `type` and its `span`. A node's docstring
summarizes its meaning; docs/language.md is the full reference. Operators and most functions work element by
element on arrays; a scalar next to an array stands for each of its elements.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import field, replace
from enum import Enum, unique

from colony.ir.bearings import Bearings
from colony.ir.types import Type, Value
from colony.record import Record, record
from colony.text.source import NOWHERE, Span


@record
class TypedNode(Record):
    """A typed expression: the base class of all nodes."""

    type: Type
    span: Span = field(default=NOWHERE, compare=False, repr=False)


@unique
class Unary(Enum):
    """An operator with one operand."""

    NEGATE = "-"
    NOT = "not"


@unique
class Binary(Enum):
    """An operator with two operands; the value is the operator's spelling."""

    ADD = "+"
    SUBTRACT = "-"
    MULTIPLY = "*"
    DIVIDE = "/"
    LESS = "<"
    LESS_EQUAL = "<="
    GREATER = ">"
    GREATER_EQUAL = ">="
    EQUAL = "=="
    NOT_EQUAL = "!="
    AND = "and"
    OR = "or"
    IMPLIES = "implies"


@unique
class Function(Enum):
    """A pure function; the value is the spelling.

    MIN MAX SUM MEAN COUNT ANY ALL take one array, or one or more scalars, and give one value.
    INDEX_OF_MIN and INDEX_OF_MAX take one array. The rest work element by element.
    """

    MIN = "min"
    MAX = "max"
    SUM = "sum"
    MEAN = "mean"
    COUNT = "count"
    ANY = "any"
    ALL = "all"
    INDEX_OF_MIN = "index_of_min"
    INDEX_OF_MAX = "index_of_max"
    ABS = "abs"
    SIGN = "sign"
    SQRT = "sqrt"
    FLOOR = "floor"
    CEIL = "ceil"
    ROUND = "round"
    MOD = "mod"
    CLAMP = "clamp"
    SIN = "sin"
    COS = "cos"
    TAN = "tan"
    ASIN = "asin"
    ACOS = "acos"
    ATAN2 = "atan2"
    ANGLE_DIFFERENCE = "angle_difference"


REDUCTIONS = frozenset(
    {Function.MIN, Function.MAX, Function.SUM, Function.MEAN, Function.COUNT, Function.ANY, Function.ALL}
)
INDEX_FUNCTIONS = frozenset({Function.INDEX_OF_MIN, Function.INDEX_OF_MAX})


@unique
class MemoryFunction(Enum):
    """A function with its own memory; the value is the spelling."""

    PREVIOUS = "previous"
    CHANGED = "changed"
    RISING = "rising"
    FALLING = "falling"
    RECENTLY = "recently"
    SUSTAINED = "sustained"
    ELAPSED = "elapsed"
    LATCH = "latch"
    CAPTURED = "captured"
    EVERY = "every"


@record
class Constant(TypedNode):
    """A literal, a param or a folded constant, in base units."""

    value: Value


@record
class SensorValue(TypedNode):
    """A sensor's value in this frame (its default where it is missing and has one)."""

    name: str


@record
class DerivedValue(TypedNode):
    """A file-level `let`, evaluated once a frame."""

    name: str


@record
class LocalValue(TypedNode):
    """A `let` of a module, by its full name `module.let`; missing where the module is silent."""

    name: str


@record
class StateValue(TypedNode):
    """The old value of a state or machine: file-level `name`, or `module.name`. Never missing."""

    name: str


@record
class LoopIndex(TypedNode):
    """The variable of an enclosing `Reduce`, as a number."""

    name: str


@record
class LoopElement(TypedNode):
    """The present element of an array of an enclosing `Reduce`."""

    name: str


@record
class Now(TypedNode):
    """Time since the first frame, in seconds: nanoseconds / 1e9."""


@record
class RestartedFlag(TypedNode):
    """True in the first frame after the runtime lost the program's memory."""


@record
class Fresh(TypedNode):
    """True if a sensor has a reading (not its default) or, if `derived`, if a `let` is not missing."""

    name: str
    derived: bool


@record
class ValueOr(TypedNode):
    """`expression`, or `other` if `expression` reads something missing (its memory is then unchanged).

    Where `expression` is an `Element` whose index is outside, it is `other`, too.
    """

    expression: Expression
    other: Expression


@record
class UnaryOperation(TypedNode):
    """`-x` or `not b`."""

    operator: Unary
    operand: Expression


@record
class BinaryOperation(TypedNode):
    """`left operator right`; both operands are evaluated, whatever the operator."""

    operator: Binary
    left: Expression
    right: Expression


@record
class Conditional(TypedNode):
    """`if condition then yes else no`; the condition is a scalar, the branches may be arrays."""

    condition: Expression
    yes: Expression
    no: Expression


@record
class Within(TypedNode):
    """`operand in low .. high`, both ends included."""

    operand: Expression
    low: Expression
    high: Expression


@record
class Element(TypedNode):
    """`array[index]`: the index is rounded (halves to even) and, if it `wraps`, taken modulo the size.

    An index that is outside, or not finite, gives NaN, or false for an array of bools.
    """

    array: Expression
    index: Expression
    wraps: bool


@record
class Nearest(TypedNode):
    """The index of the element nearest to `angle` (`bearings.nearest`); NaN where there is none."""

    bearings: Bearings
    angle: Expression


@record
class Slice(TypedNode):
    """`array[first..last]`, both ends included; `indices` are those of the elements, already wrapped."""

    array: Expression
    indices: tuple[int, ...]


@record
class Window(TypedNode):
    """`window(array, center, n)`: elements round(center) - n .. round(center) + n, each as in `Element`."""

    array: Expression
    center: Expression
    reach: int
    wraps: bool


@record
class FunctionCall(TypedNode):
    """A pure function.

    For a `Slice` or `Window`, index functions give the index in the whole array; NaN if that is outside.
    """

    function: Function
    arguments: tuple[Expression, ...]


@record
class Reduce(TypedNode):
    """`function(body for variable in low .. high [if condition])`, both ends included; empty if low > high.

    `function` is one of REDUCTIONS. Body and condition have separate memory for each value of the variable,
    which advances whether or not the condition holds. `arrays` are evaluated once, outside; body and
    condition read the element of each that has the number of the variable, which counts from 0.
    """

    function: Function
    variable: str
    low: int
    high: int
    body: Expression
    condition: Expression | None
    arrays: tuple[tuple[str, Expression], ...] = ()


@record
class MemoryCall(TypedNode):
    """A memory function; `cell` is unique to this call in the program.

    Arguments by function: PREVIOUS (e, initial), CHANGED (e), RISING FALLING ELAPSED (b), RECENTLY SUSTAINED
    (b), LATCH (set, reset), CAPTURED (e, key), EVERY (). The duration of RECENTLY, SUSTAINED and EVERY is
    `duration_ns`. Each element of an array and each value of every enclosing loop variable has its own
    memory.
    """

    function: MemoryFunction
    arguments: tuple[Expression, ...]
    cell: int
    duration_ns: int = 0


# Only in contracts and expectations:


@record
class SentField(TypedNode):
    """The value of a field of the command sent, after limits and clamping, in base units.

    Missing in a frame in which nothing is sent (`idle hold`, not commanded).
    """

    actuator: str
    field_index: int


@record
class WonBy(TypedNode):
    """True if `module` is the actuator's winner in this frame."""

    actuator: str
    module: str


@record
class IsCommanded(TypedNode):
    """True if a module's command is sent; false if the idle command replaces one that is not finite."""

    actuator: str


@record
class IsIdle(TypedNode):
    """True if no module commands the actuator in this frame."""

    actuator: str


@record
class IsActive(TypedNode):
    """True if a module or wire puts a command on its output in this frame."""

    name: str


Expression = (
    Constant
    | SensorValue
    | DerivedValue
    | LocalValue
    | StateValue
    | LoopIndex
    | LoopElement
    | Now
    | RestartedFlag
    | Fresh
    | ValueOr
    | UnaryOperation
    | BinaryOperation
    | Conditional
    | Within
    | Element
    | Nearest
    | Slice
    | Window
    | FunctionCall
    | Reduce
    | MemoryCall
    | SentField
    | WonBy
    | IsCommanded
    | IsIdle
    | IsActive
)

NESTING_LIMIT = 100
"""Maximum depth of an expression; the front end rejects deeper ones, so that later stages may recurse."""


def children(node: Expression) -> tuple[Expression, ...]:
    """Return the direct subexpressions, in the order written."""
    match node:
        case ValueOr(expression=e, other=o):
            return (e, o)
        case UnaryOperation(operand=o):
            return (o,)
        case BinaryOperation(left=a, right=b):
            return (a, b)
        case Conditional(condition=c, yes=y, no=n):
            return (c, y, n)
        case Within(operand=o, low=low, high=high):
            return (o, low, high)
        case Element(array=a, index=i):
            return (a, i)
        case Slice(array=a):
            return (a,)
        case Window(array=a, center=c):
            return (a, c)
        case FunctionCall(arguments=arguments) | MemoryCall(arguments=arguments):
            return arguments
        case Nearest(angle=a):
            return (a,)
        case Reduce(body=b, condition=c, arrays=arrays):
            return (b, *[array for _, array in arrays], *([] if c is None else [c]))
        case _:
            return ()


def subexpressions(root: Expression) -> Iterator[Expression]:
    """Yield an expression and all its subexpressions, in the order written."""
    work = [root]
    while work:
        node = work.pop()
        yield node
        work.extend(reversed(children(node)))


def rebuilt(node: Expression, change: Callable[[Expression], Expression]) -> Expression:
    """Return an expression with each direct subexpression changed."""
    match node:
        case ValueOr(expression=e, other=o):
            return replace(node, expression=change(e), other=change(o))
        case UnaryOperation(operand=o):
            return replace(node, operand=change(o))
        case BinaryOperation(left=a, right=b):
            return replace(node, left=change(a), right=change(b))
        case Conditional(condition=c, yes=y, no=n):
            return replace(node, condition=change(c), yes=change(y), no=change(n))
        case Within(operand=o, low=low, high=high):
            return replace(node, operand=change(o), low=change(low), high=change(high))
        case Element(array=a, index=i):
            return replace(node, array=change(a), index=change(i))
        case Nearest(angle=a):
            return replace(node, angle=change(a))
        case Slice(array=a):
            return replace(node, array=change(a))
        case Window(array=a, center=c):
            return replace(node, array=change(a), center=change(c))
        case FunctionCall(arguments=arguments) | MemoryCall(arguments=arguments):
            return replace(node, arguments=tuple([change(a) for a in arguments]))
        case Reduce(body=b, condition=c, arrays=arrays):
            condition = None if c is None else change(c)
            changed = tuple([(name, change(array)) for name, array in arrays])
            return replace(node, body=change(b), condition=condition, arrays=changed)
        case _:
            return node
