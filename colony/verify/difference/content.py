"""The content of a declaration, independent of its name: equal contents behave the same in every run.

The content of an expression is that of each of its elements, with arrays taken apart, reductions unrolled,
lets expanded and constants folded; so it does not matter whether it reads elements by index, by angle or one
after the other. This leaves out in which frames it is missing. So the content of a declaration contains the
sensors that it needs, and that of a memory cell those without which it does not advance.

States may read each other in a cycle, so their contents are found by refinement: at first, states with equal
initial values have the same color; then states whose `next` differs are separated, until nothing changes.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from typing import assert_never

from colony.ir import expression as ir
from colony.ir.bearings import Bearings, nearest
from colony.ir.expression import Binary, Function, Unary
from colony.ir.program import (
    AnyModule,
    Derived,
    Let,
    Limit,
    Machine,
    Module,
    Program,
    PythonModule,
    State,
)
from colony.ir.types import Array, Bool, ScalarValue, Type, Value, element_type
from colony.ir.walk import expressions_of
from colony.verify.reference import expressions
from colony.verify.reference.expressions import NAN

# --- table --------------------------------------------------------------------------------------------
#
# Numbers for contents, and the contents of operations on scalars.

Values = tuple[int, ...]
"""The contents of an expression's elements; a single one for a scalar."""


class ContentTable:
    """Numbers for contents. Mutable; shared by all programs that are compared.

    Equal numbers stand for equal values in every frame, bit for bit.
    """

    def __init__(self) -> None:
        self._numbers: dict[Hashable, int] = {}
        self._constants: dict[int, ScalarValue] = {}

    def number(self, *content: Hashable) -> int:
        """Return the number of a content; a new content gets a new number."""
        return self._numbers.setdefault(content, len(self._numbers))

    def constant(self, value: ScalarValue) -> int:
        """Return the content of a constant; true and 1 differ, 0 and -0 too."""
        number = self.number("constant", repr(value))
        self._constants[number] = value
        return number

    def known(self, content: int) -> ScalarValue | None:
        """Return the value of a constant; None for all other contents."""
        return self._constants.get(content)

    # --- operations on scalars -------------------------------------------------------------------

    def apply(self, name: Hashable, function: Callable[..., ScalarValue], *operands: int) -> int:
        """Return the content of a pure function of scalars; `name` identifies the function."""
        values = [self._constants[x] for x in operands if x in self._constants]
        if len(values) == len(operands):
            return self.constant(function(*values))
        return self.number(name, *operands)

    def unary(self, operator: Unary, x: int) -> int:
        """Return the content of `operator x`."""
        return self.apply(operator, lambda value: expressions.unary(operator, value), x)

    def binary(self, operator: Binary, x: int, y: int) -> int:
        """Return the content of `x operator y`."""
        return self.apply(operator, lambda a, b: expressions.binary(operator, a, b), x, y)

    def call(self, function: Function, *x: int) -> int:
        """Return the content of a function of scalars, or of a reduction of them; a sum is that of `+`."""
        if function is Function.SUM and x:
            return reduce(partial(self.binary, Binary.ADD), x)
        return self.apply(function, lambda *values: expressions.function(function, values), *x)

    def within(self, x: int, low: int, high: int) -> int:
        """Return the content of `x in low .. high`."""
        return self.apply("within", lambda v, lo, hi: lo <= v <= hi, x, low, high)

    def select(self, condition: int, yes: int, no: int) -> int:
        """Return the content of `if condition then yes else no`."""
        value = self.known(condition)
        if value is None:
            return yes if yes == no else self.number("select", condition, yes, no)
        return yes if value else no

    def reduction(self, function: Function, rounds: Sequence[tuple[int, int]]) -> int:
        """Return the content of a reduction, given (condition, value) of each round."""
        taken = [(c, x) for c, x in rounds if self.known(c) is not False]
        if all(self.known(c) is True for c, _ in taken):
            return self.call(function, *[x for _, x in taken])
        return self.number("reduction", function, *taken)

    # --- arrays ----------------------------------------------------------------------------------

    def is_inside(self, index: int, size: int, *, wraps: bool) -> bool | None:
        """Return whether an index is inside an array; None if it is not constant."""
        value = self.known(index)
        return None if value is None else expressions.position(value, size, wraps) is not None

    def element(self, array: Values, index: int, *, wraps: bool, are_bools: bool) -> int:
        """Return the content of `array[index]`; NaN or false where the index is outside."""
        value = self.known(index)
        if value is None:
            return self.number("element", wraps, index, array)
        place = expressions.position(value, len(array), wraps)
        if place is None:
            return self.constant(False if are_bools else expressions.NAN)
        return array[place]


# --- content ------------------------------------------------------------------------------------------

Needs = frozenset[str]
"""The sensors without which something is missing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ContentScope:
    """The context of an expression.

    Attributes:
        ready: the sensors without which its memory does not advance.
        loops: by name, the contents of the variables and present elements of the enclosing reductions.
    """

    ready: Needs
    loops: Mapping[str, int] = field(default_factory=dict)


class Contents:
    """The contents of one program's declarations. Mutable: `refine` separates the colors of states."""

    def __init__(self, program: Program, table: ContentTable) -> None:
        self._table = table
        self._sensors = {s.name: s for s in program.robot.sensors}
        self._lets: dict[str, Let] = {}
        self._states: dict[str, State | Machine] = {}
        self._module_of: dict[str, Module] = {}
        for derived in program.derived:
            self._declare(derived)
        for module in program.modules:
            if isinstance(module, Module):
                self._lets |= {let.name: let for let in module.lets}
                self._states |= {state.name: state for state in module.states}
                self._module_of |= {x.name: module for x in (*module.lets, *module.states)}
        self._let_values: dict[str, Values] = {}
        self._module_needs: dict[str, Needs] = {}
        self._needed: dict[str, Needs] = {}
        self._colors = {name: self._initial_color(state) for name, state in self._states.items()}

    def _declare(self, derived: Derived) -> None:
        match derived:
            case Let():
                self._lets[derived.name] = derived
            case State() | Machine():
                self._states[derived.name] = derived
            case _:
                assert_never(derived)

    # --- states ----------------------------------------------------------------------------------

    def _initial_color(self, state: State | Machine) -> int:
        match state:
            case State(initial=initial):
                return self._table.number("state", _value_key(initial))
            case Machine(start=start):
                return self._table.number("machine", start)
            case _:
                assert_never(state)

    def refine(self) -> None:
        """Separate states by the current colors of the states that they read."""
        self._let_values.clear()
        self._colors = {
            name: self._table.number(self._colors[name], self._next_content(state))
            for name, state in self._states.items()
        }
        self._let_values.clear()

    def colors(self) -> frozenset[int]:
        """Return the colors of all states."""
        return frozenset(self._colors.values())

    def _next_content(self, state: State | Machine) -> int:
        match state:
            case State(next=next_value):
                if next_value is None:
                    return self._table.number("unchanging")
                module = self._module_of.get(state.name)
                return self._expression(next_value, None if module is None else self.needs(module))
            case Machine(transitions=transitions):
                steps = [
                    (t.sources, t.target, t.failsafe, self._expression(t.condition)) for t in transitions
                ]
                return self._table.number("transitions", *steps)
            case _:
                assert_never(state)

    # --- declarations ----------------------------------------------------------------------------

    def derived(self, derived: Derived) -> int:
        """Return the content of a file-level derived value."""
        match derived:
            case Let(expression=expression):
                return self._expression(expression)
            case State(name=name) | Machine(name=name):
                return self._table.number("memory", self._colors[name])
            case _:
                assert_never(derived)

    def module(self, module: AnyModule) -> int:
        """Return the content of a module, which leaves out the actuator's name."""
        match module:
            case Module(command=command):
                needs = self.needs(module)
                fields = () if command is None else tuple(self._expression(e, needs) for e in command.fields)
                state_colors = frozenset(self._colors[s.name] for s in module.states)
                return self._table.number(
                    "module",
                    module.failsafe,
                    command is None,
                    self._expression(module.when, needs),
                    fields,
                    state_colors,
                )
            case PythonModule():
                reads = tuple((r.name, self._expression(r.expression)) for r in module.reads)
                params = tuple((n, _value_key(v)) for n, v in module.params)
                identity = (
                    module.failsafe,
                    module.module_path,
                    module.class_name,
                    params,
                    module.rate_ns,
                )
                return self._table.number("python", identity, reads, module.actuator is None)
            case _:
                assert_never(module)

    def limit(self, limit: Limit) -> int:
        """Return the content of a limit, which leaves out the actuator's name."""
        condition = None if limit.condition is None else self._expression(limit.condition)
        bound = self._expression(limit.bound)
        return self._table.number("limit", limit.field_index, limit.relation, bound, condition)

    def _expression(self, e: ir.Expression, needs: Needs | None = None) -> int:
        """Return the content of an expression, and in which frames it has a value.

        By default, these are those in which nothing that it reads is missing.
        """
        ready = self.needed_sensors(e) if needs is None else needs
        return self._table.number("expression", ready, self._values(e, ContentScope(ready=ready)))

    # --- expressions -----------------------------------------------------------------------------

    def _value(self, e: ir.Expression, scope: ContentScope) -> int:
        (value,) = self._values(e, scope)
        return value

    def _values(self, e: ir.Expression, scope: ContentScope) -> Values:
        """Return the contents of the elements of an expression."""
        table = self._table
        match e:
            case ir.UnaryOperation(operator=operator, operand=operand):
                return _each(partial(table.unary, operator), self._values(operand, scope))
            case ir.BinaryOperation(operator=operator, left=left, right=right):
                return _each(
                    partial(table.binary, operator), self._values(left, scope), self._values(right, scope)
                )
            case ir.Conditional():
                return _each(table.select, *[self._values(x, scope) for x in ir.children(e)])
            case ir.Within():
                return _each(table.within, *[self._values(x, scope) for x in ir.children(e)])
            case ir.Element() | ir.Slice() | ir.Window() | ir.Nearest():
                return self._array_access(e, scope)
            case ir.ValueOr():
                return self._value_or(e, scope)
            case ir.FunctionCall():
                return self._call(e, scope)
            case ir.Reduce():
                return (self._reduce(e, scope),)
            case ir.MemoryCall(function=function, duration_ns=duration_ns):
                cell = partial(table.number, "cell", function, duration_ns, scope.ready)
                return _each(cell, *[self._values(x, scope) for x in e.arguments])
            case _:
                return self._leaf(e, scope)

    def _leaf(self, e: ir.Expression, scope: ContentScope) -> Values:
        table = self._table
        match e:
            case ir.Constant(value=value):
                return tuple(table.constant(x) for x in (value if isinstance(value, tuple) else (value,)))
            case ir.SensorValue(name=name, type=type_):
                return tuple(table.number("sensor", name, i) for i in range(_size(type_)))
            case ir.DerivedValue(name=name) | ir.LocalValue(name=name):
                return self._let(name)
            case ir.StateValue(name=name):
                return (table.number("memory", self._colors[name]),)
            case ir.LoopIndex(name=name) | ir.LoopElement(name=name):
                return (scope.loops[name],)
            case ir.Fresh(name=name, derived=derived):
                needs = self.needed_sensors(self._lets[name].expression) if derived else frozenset((name,))
                return (table.number("fresh", needs),)
            case ir.Now() | ir.RestartedFlag():
                return (table.number(type(e).__name__),)
            case _:
                raise AssertionError(f"{type(e).__name__} stands only in contracts")

    def _let(self, name: str) -> Values:
        if name not in self._let_values:
            expression, module = self._lets[name].expression, self._module_of.get(name)
            ready = self.needed_sensors(expression) if module is None else self.needs(module)
            self._let_values[name] = self._values(expression, ContentScope(ready=ready))
        return self._let_values[name]

    def _value_or(self, e: ir.ValueOr, scope: ContentScope) -> Values:
        table, needs = self._table, self.needed_sensors(e.expression)
        inner, is_inside = replace(scope, ready=scope.ready | needs), True
        values, others = self._values(e.expression, inner), self._values(e.other, scope)
        if isinstance(e.expression, ir.Element):
            index = self._value(e.expression.index, inner)
            size = _size(e.expression.array.type)
            known = table.is_inside(index, size, wraps=e.expression.wraps)
            if known is False:
                return others
            is_inside = known is not None
        if not needs and is_inside:
            return _each(lambda value, _: value, values, others)
        return _each(partial(table.number, "value or", needs, is_inside), values, others)

    def _array_access(self, e: ir.Element | ir.Slice | ir.Window | ir.Nearest, scope: ContentScope) -> Values:
        table = self._table
        match e:
            case ir.Nearest(bearings=bearings, angle=angle):
                of_angle = partial(_nearest, bearings)
                return (table.apply(("nearest", bearings), of_angle, self._value(angle, scope)),)
            case ir.Element(array=array):
                index = self._value(e.index, scope)
                are_bools = isinstance(element_type(array.type), Bool)
                whole = self._values(array, scope)
                return (table.element(whole, index, wraps=e.wraps, are_bools=are_bools),)
            case ir.Slice(array=array, indices=indices):
                whole = self._values(array, scope)
                return tuple(whole[i] for i in indices)
            case ir.Window(array=array, center=center):
                whole = self._values(array, scope)
                content = table.number("window", e.reach, e.wraps, self._value(center, scope), whole)
                return tuple(table.number("in window", content, i) for i in range(2 * e.reach + 1))

    def _call(self, e: ir.FunctionCall, scope: ContentScope) -> Values:
        table = self._table
        arguments = [self._values(x, scope) for x in e.arguments]
        if e.function in ir.REDUCTIONS:
            return (table.call(e.function, *[x for values in arguments for x in values]),)
        if e.function in ir.INDEX_FUNCTIONS:
            (array,), (values,) = e.arguments, arguments
            is_window = isinstance(array, ir.Window)  # then the index is one of the whole array, too
            indices = array.indices if isinstance(array, ir.Slice) else range(len(values))
            return (table.number(e.function, values, tuple(indices), is_window),)
        return _each(partial(table.call, e.function), *arguments)

    def _reduce(self, e: ir.Reduce, scope: ContentScope) -> int:
        arrays = {name: self._values(array, scope) for name, array in e.arrays}
        rounds = []
        for k in range(e.low, e.high + 1):
            elements = {name: values[k] for name, values in arrays.items()}
            present = {e.variable: self._table.constant(float(k)), **elements}
            inner = replace(scope, loops={**scope.loops, **present})
            condition = self._table.constant(True) if e.condition is None else self._value(e.condition, inner)
            rounds.append((condition, self._value(e.body, inner)))
        return self._table.reduction(e.function, rounds)

    # --- needed sensors --------------------------------------------------------------------------

    def needs(self, module: AnyModule) -> Needs:
        """Return the sensors without which a module is silent, or blind if it is failsafe."""
        if module.name not in self._module_needs:
            needed = (self.needed_sensors(e) for e in expressions_of(module))
            self._module_needs[module.name] = frozenset[str]().union(*needed)
        return self._module_needs[module.name]

    def needed_sensors(self, e: ir.Expression) -> Needs:
        """Return the sensors without which an expression is missing."""
        match e:
            case ir.SensorValue(name=name):
                return frozenset() if self._sensors[name].default is not None else frozenset({name})
            case ir.DerivedValue(name=name) | ir.LocalValue(name=name):
                if name not in self._needed:
                    self._needed[name] = self.needed_sensors(self._lets[name].expression)
                return self._needed[name]
            case ir.ValueOr(other=other):
                return self.needed_sensors(other)
            case _:
                return frozenset[str]().union(*(self.needed_sensors(child) for child in ir.children(e)))


def contents(a: Program, b: Program) -> tuple[Contents, Contents]:
    """Return the contents of two programs, with numbers that can be compared."""
    table = ContentTable()
    pair = Contents(a, table), Contents(b, table)
    classes = 0
    while len(pair[0].colors() | pair[1].colors()) > classes:
        classes = len(pair[0].colors() | pair[1].colors())
        for program_contents in pair:
            program_contents.refine()
    return pair


def _each(function: Callable[..., int], *operands: Values) -> Values:
    """Apply a function to the operands, element by element; a scalar stands for each element."""
    size = max((len(x) for x in operands), default=1)
    return tuple(function(*[x[i] if len(x) > 1 else x[0] for x in operands]) for i in range(size))


def _size(type_: Type) -> int:
    return type_.size if isinstance(type_, Array) else 1


def _nearest(bearings: Bearings, angle: float) -> float:
    index = nearest(bearings, angle)
    return NAN if index is None else float(index)


def _value_key(value: Value) -> str:
    """Return a key of a value that distinguishes true from 1, and 0 from -0."""
    return repr(value)
