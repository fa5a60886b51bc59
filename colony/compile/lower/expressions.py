"""Lowering of typed expressions to scalar ops: arrays become their elements, loops are unrolled.

An expression has as many values as its type has elements. Every op is total, so the condition that everything
an expression reads is present is a value of its own (`present`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from math import nan
from typing import Protocol, assert_never

from colony.compile.lower.builder import CodeBuilder
from colony.compile.lower.memory import MemorySite, remember
from colony.execute.code import (
    Commanded,
    FrameTime,
    Kind,
    Literal,
    Restarted,
    SensorElement,
    SensorFresh,
    Sent,
    Winner,
)
from colony.execute.operators import Operator
from colony.ir import expression as ir
from colony.ir.bearings import TURN, Bearings, lookup
from colony.ir.expression import Binary, Function, Unary
from colony.ir.memory import function_cell
from colony.ir.types import Array, Bool, Type, element_type

Values = tuple[int, ...]
"""The op numbers of an expression's elements; a single one for a scalar."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoweringScope:
    """The context of an expression.

    Attributes:
        owner: the module that it belongs to, if any.
        label: the prefix of the names of its memory cells.
        ready: the condition for updating its memory.
        loops: the variables and current indices of the enclosing reductions.
        elements: by name, the current elements of the arrays of the enclosing reductions.
    """

    owner: str | None
    label: str
    ready: int
    loops: tuple[tuple[str, int], ...] = ()
    elements: Mapping[str, int] = field(default_factory=dict)


class NameResolver(Protocol):
    """The meanings of names in expressions."""

    def sensor_kind(self, sensor: str) -> Kind:
        """Return the kind of a sensor's value or elements."""
        ...

    def sensor_present(self, sensor: str) -> int:
        """Return the condition that a sensor has a value."""
        ...

    def let(self, name: str) -> Values:
        """Return the values of a let."""
        ...

    def let_present(self, name: str) -> int:
        """Return the condition that a file-level let is not missing."""
        ...

    def module_of_let(self, name: str) -> str:
        """Return the name of the module that a let belongs to."""
        ...

    def module_present(self, module: str) -> int:
        """Return the condition that everything the module reads is present."""
        ...

    def state(self, name: str) -> int:
        """Return the value of a state."""
        ...

    def active(self, name: str) -> int:
        """Return the condition that a module or wire is active."""
        ...

    def has_idle_command(self, actuator: str) -> bool:
        """Return True unless the actuator is `idle hold`."""
        ...

    def field_kind(self, actuator: str, index: int) -> Kind:
        """Return the kind of a field of an actuator."""
        ...


_FUNCTIONS: dict[Function, Operator] = {
    Function.ABS: Operator.ABS,
    Function.SIGN: Operator.SIGN,
    Function.SQRT: Operator.SQRT,
    Function.FLOOR: Operator.FLOOR,
    Function.CEIL: Operator.CEIL,
    Function.ROUND: Operator.ROUND,
    Function.MOD: Operator.MODULO,
    Function.SIN: Operator.SIN,
    Function.COS: Operator.COS,
    Function.TAN: Operator.TAN,
    Function.ASIN: Operator.ASIN,
    Function.ACOS: Operator.ACOS,
    Function.ATAN2: Operator.ATAN2,
}


class ExpressionLowering:
    """Lowers expressions into one builder."""

    def __init__(self, builder: CodeBuilder, names: NameResolver) -> None:
        self.builder = builder
        self.names = names
        self._sensors: dict[str, Values] = {}

    # --- presence --------------------------------------------------------------------------------

    def present(self, expressions: tuple[ir.Expression, ...], owner: str | None) -> int:
        """Return the condition that all inputs of `expressions` are present (lets of `owner` always are)."""
        conditions: dict[int, None] = {}
        for expression in expressions:
            self._needs(expression, owner, conditions)
        return self.builder.both(*conditions)

    def _needs(self, e: ir.Expression, owner: str | None, conditions: dict[int, None]) -> None:
        match e:
            case ir.SensorValue(name=name):
                conditions[self.names.sensor_present(name)] = None
            case ir.DerivedValue(name=name):
                conditions[self.names.let_present(name)] = None
            case ir.LocalValue(name=name):
                module = self.names.module_of_let(name)
                if module != owner:
                    conditions[self.names.module_present(module)] = None
            case ir.SentField(actuator=actuator):
                if not self.names.has_idle_command(actuator):
                    conditions[self.builder.add(Commanded(actuator), Kind.BOOL)] = None
            case ir.ValueOr(other=other):
                self._needs(other, owner, conditions)
            case _:
                for child in ir.children(e):
                    self._needs(child, owner, conditions)

    # --- values ----------------------------------------------------------------------------------

    def scalar(self, e: ir.Expression, scope: LoweringScope) -> int:
        """Return the op number of a scalar expression's value."""
        (value,) = self.lower(e, scope)
        return value

    def lower(self, e: ir.Expression, scope: LoweringScope) -> Values:
        """Return the op numbers of an expression's values."""
        apply = self.builder.apply
        match e:
            case ir.Constant(value=value):
                literal = self.builder.literal
                return tuple([literal(x) for x in value]) if isinstance(value, tuple) else (literal(value),)
            case ir.SensorValue(name=name, type=type_):
                return self._sensor(name, type_)
            case ir.UnaryOperation(operator=operator, operand=operand):
                function = self.builder.negation if operator is Unary.NOT else partial(apply, Operator.NEGATE)
                return self._each(function, self.lower(operand, scope))
            case ir.BinaryOperation(operator=operator, left=left, right=right):
                return self._each(
                    partial(self.binary, operator), self.lower(left, scope), self.lower(right, scope)
                )
            case ir.Conditional(condition=condition, yes=yes, no=no):
                conditions = self.lower(condition, scope)
                return self._each(
                    partial(apply, Operator.SELECT), conditions, self.lower(yes, scope), self.lower(no, scope)
                )
            case ir.Within(operand=operand, low=low, high=high):
                return self._each(
                    self.within, self.lower(operand, scope), self.lower(low, scope), self.lower(high, scope)
                )
            case ir.Nearest(bearings=bearings, angle=angle):
                return (self.nearest(bearings, self.scalar(angle, scope)),)
            case ir.Element() | ir.Slice() | ir.Window():
                return self._array_access(e, self.lower(e.array, scope), scope)
            case ir.ValueOr():
                return self._value_or(e, scope)
            case ir.FunctionCall():
                return self._call(e, scope)
            case ir.Reduce():
                return (self._reduce(e, scope),)
            case ir.MemoryCall():
                return self._memory(e, scope)
            case _:
                return self._leaf(e, scope)

    def _each(self, function: Callable[..., int], *operands: Values) -> Values:
        """Apply a function to the operands, element by element; a scalar is repeated for all elements."""
        size = max([len(x) for x in operands])
        if size == 1:
            return (function(*[x[0] for x in operands]),)
        return tuple(function(*[x[i] if len(x) > 1 else x[0] for x in operands]) for i in range(size))

    def binary(self, operator: Binary, x: int, y: int) -> int:
        """Return `x operator y`."""
        builder = self.builder
        match operator:
            case Binary.ADD:
                return builder.apply(Operator.ADD, x, y)
            case Binary.SUBTRACT:
                return builder.apply(Operator.SUBTRACT, x, y)
            case Binary.MULTIPLY:
                return builder.apply(Operator.MULTIPLY, x, y)
            case Binary.DIVIDE:
                return builder.apply(Operator.DIVIDE, x, y)
            case Binary.LESS:
                return builder.apply(Operator.LESS, x, y)
            case Binary.LESS_EQUAL:
                return builder.apply(Operator.LESS_EQUAL, x, y)
            case Binary.GREATER:
                return builder.apply(Operator.LESS, y, x)
            case Binary.GREATER_EQUAL:
                return builder.apply(Operator.LESS_EQUAL, y, x)
            case Binary.EQUAL:
                return builder.apply(Operator.EQUAL, x, y)
            case Binary.NOT_EQUAL:
                return builder.apply(Operator.NOT_EQUAL, x, y)
            case Binary.AND:
                return builder.both(x, y)
            case Binary.OR:
                return builder.either(x, y)
            case Binary.IMPLIES:
                return builder.either(builder.negation(x), y)
            case _:
                assert_never(operator)

    def within(self, x: int, low: int, high: int) -> int:
        """Return `x in low .. high`."""
        apply = self.builder.apply
        return self.builder.both(apply(Operator.LESS_EQUAL, low, x), apply(Operator.LESS_EQUAL, x, high))

    def _leaf(self, e: ir.Expression, scope: LoweringScope) -> Values:
        builder, names = self.builder, self.names
        match e:
            case ir.DerivedValue(name=name) | ir.LocalValue(name=name):
                return names.let(name)
            case ir.StateValue(name=name):
                return (names.state(name),)
            case ir.LoopIndex(name=name):
                return (builder.literal(float([k for variable, k in scope.loops if variable == name][-1])),)
            case ir.LoopElement(name=name):
                return (scope.elements[name],)
            case ir.Now():
                return (builder.apply(Operator.SECONDS, builder.add(FrameTime(), Kind.TIME)),)
            case ir.RestartedFlag():
                return (builder.add(Restarted(), Kind.BOOL),)
            case ir.Fresh(name=name, derived=derived):
                fresh = names.let_present(name) if derived else builder.add(SensorFresh(name), Kind.BOOL)
                return (fresh,)
            case _:
                return (self._decision(e),)

    def _sensor(self, name: str, type_: Type) -> Values:
        if name not in self._sensors:
            kind = self.names.sensor_kind(name)
            size = type_.size if isinstance(type_, Array) else 1
            self._sensors[name] = tuple(self.builder.add(SensorElement(name, i), kind) for i in range(size))
        return self._sensors[name]

    def _decision(self, e: ir.Expression) -> int:
        """Lower an expression about the decision, which only contracts and tests may contain."""
        builder = self.builder
        match e:
            case ir.SentField(actuator=actuator, field_index=i):
                return builder.add(Sent(actuator, i), self.names.field_kind(actuator, i))
            case ir.WonBy(actuator=actuator, module=module):
                return builder.add(Winner(actuator, module), Kind.BOOL)
            case ir.IsCommanded(actuator=actuator):
                return builder.add(Commanded(actuator), Kind.BOOL)
            case ir.IsIdle(actuator=actuator):
                return builder.negation(builder.add(Commanded(actuator), Kind.BOOL))
            case ir.IsActive(name=name):
                return self.names.active(name)
            case _:
                raise AssertionError(f"{type(e).__name__} has operands")

    def _value_or(self, e: ir.ValueOr, scope: LoweringScope) -> Values:
        is_present = self.present((e.expression,), scope.owner)
        inner = replace(scope, ready=self.builder.both(scope.ready, is_present))
        if isinstance(e.expression, ir.Element):
            whole = self.lower(e.expression.array, inner)
            value, place = self._element(e.expression, whole, inner)
            condition = self.builder.both(is_present, self.builder.apply(Operator.FINITE, place))
            return (self.builder.apply(Operator.SELECT, condition, value, self.scalar(e.other, scope)),)
        return self._each(
            partial(self.builder.apply, Operator.SELECT),
            (is_present,),
            self.lower(e.expression, inner),
            self.lower(e.other, scope),
        )

    # --- arrays ----------------------------------------------------------------------------------

    def _array_access(
        self, e: ir.Element | ir.Slice | ir.Window, whole: Values, scope: LoweringScope
    ) -> Values:
        match e:
            case ir.Element():
                value, _ = self._element(e, whole, scope)
                return (value,)
            case ir.Slice(indices=indices):
                return tuple(whole[i] for i in indices)
            case ir.Window(center=center):
                indices = self.window_indices(e, len(whole), self.scalar(center, scope))
                return tuple(self.pick(whole, i) for i in indices)

    def _element(self, e: ir.Element, whole: Values, scope: LoweringScope) -> tuple[int, int]:
        """Return an element and its position, which is not finite where the index is outside."""
        place = self.position(e, len(whole), self.scalar(e.index, scope))
        return self.pick(whole, place), place

    def position(self, e: ir.Element | ir.Window, size: int, index: int) -> int:
        """Return an index that is inside as it is, or rounded; NaN for one that is outside."""
        if e.wraps or (isinstance(e, ir.Element) and isinstance(e.index, ir.Nearest)):
            return index
        apply, literal = self.builder.apply, self.builder.literal
        place = apply(Operator.ROUND, index)
        is_inside = self.within(place, literal(0.0), literal(float(size - 1)))
        return apply(Operator.SELECT, is_inside, place, literal(nan))

    def nearest(self, bearings: Bearings, angle: int) -> int:
        """Return the index of the element whose bearing is nearest to an angle, NaN where there is none."""
        apply, literal = self.builder.apply, self.builder.literal
        table = lookup(bearings)
        turned = apply(Operator.MODULO, angle, literal(float(TURN)))
        piece = apply(Operator.COUNT, *[apply(Operator.LESS, literal(b), turned) for b in table.breaks])
        index = self.pick(tuple(literal(nan if i is None else float(i)) for i in table.indices), piece)
        return apply(Operator.SELECT, apply(Operator.FINITE, angle), index, literal(nan))

    def pick(self, array: Values, index: int) -> int:
        """Return the element at an index; NaN or false where the index is not finite."""
        op, size = self.builder.ops[index], len(array)
        if isinstance(op, Literal) and op.value - op.value == 0:
            return array[round(op.value) % size]
        are_bools = self.builder.kinds[array[0]] is Kind.BOOL
        operator = Operator.PICK_BOOL if are_bools else Operator.PICK_NUMBER
        return self.builder.apply(operator, self.builder.table(array), index)

    def window_indices(self, e: ir.Window, size: int, center: int) -> Values:
        """Return the indices of a window's elements, not yet wrapped; NaN for one that is outside.

        They are exact: what wraps is first taken modulo the size, and what does not is small, or outside.
        """
        apply, literal = self.builder.apply, self.builder.literal
        middle = apply(Operator.ROUND, center)
        if e.wraps:
            middle = apply(Operator.MODULO, middle, literal(float(size)))
        places = (apply(Operator.ADD, middle, literal(float(j))) for j in range(-e.reach, e.reach + 1))
        return tuple(self.position(e, size, place) for place in places)

    def _index_function(self, function: Function, e: ir.Expression, scope: LoweringScope) -> int:
        """Return the index of the least or greatest element, which is always an index of the whole array."""
        match e:
            case ir.Slice(indices=indices):
                position = self.index_of(function, self.lower(e, scope))
                return self.pick(tuple(self.builder.literal(float(i)) for i in indices), position)
            case ir.Window(array=array, center=center):
                whole = self.lower(array, scope)
                indices = self.window_indices(e, len(whole), self.scalar(center, scope))
                best = self.index_of(function, tuple(self.pick(whole, i) for i in indices))
                return self.place_in_window(e, indices, best, len(whole))
            case _:
                return self.index_of(function, self.lower(e, scope))

    def place_in_window(self, e: ir.Window, indices: Values, best: int, size: int) -> int:
        """Return the index, in the whole array, of the element of a window that is number `best` in it."""
        place = self.pick(indices, best)
        if not e.wraps:
            return place
        return self.builder.apply(Operator.MODULO, place, self.builder.literal(float(size)))

    def index_of(self, function: Function, x: Values) -> int:
        """Return the index of the least or greatest of the values."""
        operator = Operator.INDEX_OF_MIN if function is Function.INDEX_OF_MIN else Operator.INDEX_OF_MAX
        return self.builder.apply(operator, *x)

    # --- functions -------------------------------------------------------------------------------

    def _call(self, e: ir.FunctionCall, scope: LoweringScope) -> Values:
        if e.function in ir.INDEX_FUNCTIONS:
            return (self._index_function(e.function, e.arguments[0], scope),)
        arguments = [self.lower(a, scope) for a in e.arguments]
        if e.function in ir.REDUCTIONS:
            return (self.reduction(e.function, tuple(x for a in arguments for x in a)),)
        return self._each(partial(self.function, e.function), *arguments)

    def function(self, function: Function, *x: int) -> int:
        """Return a function of scalars that is no reduction."""
        apply = self.builder.apply
        match function:
            case Function.CLAMP:
                return apply(Operator.MIN, apply(Operator.MAX, x[0], x[1]), x[2])
            case Function.ANGLE_DIFFERENCE:
                turn = self.builder.literal(360.0)
                d = apply(Operator.MODULO, apply(Operator.SUBTRACT, x[0], x[1]), turn)
                is_small = apply(Operator.LESS_EQUAL, d, self.builder.literal(180.0))
                return apply(Operator.SELECT, is_small, d, apply(Operator.SUBTRACT, d, turn))
            case _:
                return apply(_FUNCTIONS[function], *x)

    def reduction(self, function: Function, x: Values) -> int:
        """Return a reduction of one or more values."""
        apply = self.builder.apply
        match function:
            case Function.MIN:
                return apply(Operator.MIN, *x)
            case Function.MAX:
                return apply(Operator.MAX, *x)
            case Function.SUM:
                return apply(Operator.SUM, *x)
            case Function.MEAN:
                return apply(Operator.DIVIDE, apply(Operator.SUM, *x), self.builder.literal(float(len(x))))
            case Function.COUNT:
                return apply(Operator.COUNT, *x)
            case Function.ANY:
                return self.builder.either(*x)
            case Function.ALL:
                return self.builder.both(*x)
            case _:
                raise AssertionError(f"{function} is not a reduction")

    def _reduce(self, e: ir.Reduce, scope: LoweringScope) -> int:
        bodies, conditions = [], []
        arrays = {name: self.lower(array, scope) for name, array in e.arrays}
        for k in range(e.low, e.high + 1):
            elements = {**scope.elements, **{name: array[k] for name, array in arrays.items()}}
            inner = replace(scope, loops=(*scope.loops, (e.variable, k)), elements=elements)
            bodies.append(self.scalar(e.body, inner))
            conditions.append(
                self.builder.literal(True) if e.condition is None else self.scalar(e.condition, inner)
            )
        return self.reduction_of(e.function, bodies, conditions)

    def reduction_of(self, function: Function, bodies: list[int], conditions: list[int]) -> int:
        """Return the reduction of the bodies whose conditions are true."""
        if bodies and all(self.builder.is_true(c) for c in conditions):
            return self.reduction(function, tuple(bodies))
        return self._conditional_reduction(function, bodies, conditions)

    def _conditional_reduction(self, function: Function, bodies: list[int], conditions: list[int]) -> int:
        """Return the reduction of the bodies whose conditions are true; there may be none."""
        builder = self.builder
        pairs = list(zip(conditions, bodies, strict=True))
        match function:
            case Function.COUNT:
                return builder.apply(Operator.COUNT, *[builder.both(c, b) for c, b in pairs])
            case Function.ANY:
                return builder.either(*[builder.both(c, b) for c, b in pairs])
            case Function.ALL:
                return builder.both(*[builder.either(builder.negation(c), b) for c, b in pairs])
            case Function.MIN:
                return self._fold(Operator.MIN, pairs, nan)
            case Function.MAX:
                return self._fold(Operator.MAX, pairs, nan)
            case Function.SUM:
                return self._fold(Operator.SUM, pairs, 0.0)
            case Function.MEAN:
                number = builder.apply(Operator.COUNT, *conditions)
                return builder.apply(Operator.DIVIDE, self._fold(Operator.SUM, pairs, 0.0), number)
            case _:
                raise AssertionError(f"{function} is not a reduction")

    def _fold(self, operator: Operator, pairs: list[tuple[int, int]], empty_value: float) -> int:
        """Fold from the left the bodies whose conditions are true; the first of them is the initial value."""
        builder = self.builder
        result, any_taken = builder.literal(empty_value), builder.literal(False)
        for condition, body in pairs:
            joined = builder.apply(Operator.SELECT, any_taken, builder.apply(operator, result, body), body)
            result = builder.apply(Operator.SELECT, condition, joined, result)
            any_taken = builder.either(any_taken, condition)
        return result

    # --- memory ----------------------------------------------------------------------------------

    def _memory(self, e: ir.MemoryCall, scope: LoweringScope) -> Values:
        arguments = [self.lower(a, scope) for a in e.arguments]
        size = max((len(a) for a in arguments), default=1)
        return tuple(
            self.memory(e, tuple(a[i] if len(a) > 1 else a[0] for a in arguments), scope, i, size)
            for i in range(size)
        )

    def memory(self, e: ir.MemoryCall, arguments: Values, scope: LoweringScope, i: int, size: int) -> int:
        """Return one element, of `size`, of a memory function's value, given those of its arguments."""
        loops = "".join(f" {variable}={k}" for variable, k in scope.loops)
        name = f"{scope.label} {e.function.value} {e.cell}{loops}"
        cell = function_cell(e.function.value, e.cell, tuple(k for _, k in scope.loops), i)
        site = MemorySite(name=f"{name} [{i}]" if size > 1 else name, cells=(cell,), ready=scope.ready)
        return remember(self.builder, e, arguments, site)


def kind_of(type_: Type) -> Kind:
    """Return the kind of a value, or of an element, of this type."""
    return Kind.BOOL if isinstance(element_type(type_), Bool) else Kind.NUMBER
