"""The content of a declaration, independent of its name: equal contents behave the same in every run.

The content of an expression is a number that stands for the nested tuple of the expression's parts, with
names replaced by the contents of what they name. Lets without memory are expanded. States may read each other
in a cycle, so their contents are found by refinement: at first, states with equal initial values have the
same color; then states whose `next` differs are separated, until nothing changes.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import assert_never

from colony.ir import expression as ir
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
from colony.ir.types import Value
from colony.ir.walk import expressions_of

Loop = tuple[str, ...]


class Table:
    """Numbers for contents. Mutable; shared by all programs that are compared."""

    def __init__(self) -> None:
        self._numbers: dict[Hashable, int] = {}

    def number(self, *content: Hashable) -> int:
        """Return the number of a content; a new content gets a new number."""
        return self._numbers.setdefault(content, len(self._numbers))


class Contents:
    """The contents of one program's declarations. Mutable: `refine` separates the colors of states."""

    def __init__(self, program: Program, table: Table) -> None:
        self._table = table
        self._sensors = {s.name: s for s in program.robot.sensors}
        self._lets: dict[str, Let] = {}
        self._states: dict[str, State | Machine] = {}
        for derived in program.derived:
            self._declare(derived)
        for module in program.modules:
            if isinstance(module, Module):
                self._lets |= {let.name: let for let in module.lets}
                self._states |= {state.name: state for state in module.states}
        self._file_level = {d.name for d in program.derived}
        self._let_contents: dict[str, int] = {}
        self._module_needs: dict[str, frozenset[str]] = {}
        self._needed: dict[str, frozenset[str]] = {}
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
        self._let_contents.clear()
        self._colors = {
            name: self._table.number(self._colors[name], self._next_content(state))
            for name, state in self._states.items()
        }
        self._let_contents.clear()

    def colors(self) -> frozenset[int]:
        """Return the colors of all states."""
        return frozenset(self._colors.values())

    def _next_content(self, state: State | Machine) -> int:
        match state:
            case State(next=next_value):
                return -1 if next_value is None else self.expression(next_value)
            case Machine(transitions=transitions):
                steps = [(t.sources, t.target, t.failsafe, self.expression(t.condition)) for t in transitions]
                return self._table.number("transitions", *steps)
            case _:
                assert_never(state)

    # --- declarations ----------------------------------------------------------------------------

    def derived(self, derived: Derived) -> int:
        """Return the content of a file-level derived value."""
        match derived:
            case Let(name=name):
                return self._let(name)
            case State(name=name) | Machine(name=name):
                return self._table.number("memory", self._colors[name])
            case _:
                assert_never(derived)

    def module(self, module: AnyModule) -> int:
        """Return the content of a module, which leaves out the actuator's name."""
        match module:
            case Module(command=command):
                fields = () if command is None else tuple(self.expression(e) for e in command.fields)
                needs = self.needs(module)
                state_colors = frozenset(self._colors[s.name] for s in module.states)
                return self._table.number(
                    "module",
                    module.failsafe,
                    command is None,
                    self.expression(module.when),
                    fields,
                    needs,
                    state_colors,
                )
            case PythonModule():
                reads = tuple((r.name, self.expression(r.expression)) for r in module.reads)
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
        condition = -1 if limit.condition is None else self.expression(limit.condition)
        bound = self.expression(limit.bound)
        return self._table.number("limit", limit.field_index, limit.relation, bound, condition)

    # --- expressions -----------------------------------------------------------------------------

    def expression(self, e: ir.Expression, loop: Loop = ()) -> int:
        """Return the content of an expression; `loop` has the variables of the enclosing reductions."""
        match e:
            case ir.Constant(value=value):
                return self._table.number("constant", _value_key(value))
            case ir.SensorValue(name=name):
                return self._table.number("sensor", name)
            case ir.DerivedValue(name=name):
                return self._let(name)
            case ir.LocalValue(name=name):
                return self._local(name)
            case ir.StateValue(name=name):
                is_file_level = name in self._file_level
                return self._table.number("memory" if is_file_level else "own memory", self._colors[name])
            case ir.LoopIndex(name=name):
                return self._table.number("index", loop[::-1].index(name))
            case ir.Fresh(name=name, derived=derived):
                return self._table.number("fresh", self._let(name) if derived else name)
            case ir.Reduce(condition=condition):
                inner = (*loop, e.variable)
                condition_content = -1 if condition is None else self.expression(condition, inner)
                body = self.expression(e.body, inner)
                return self._table.number("reduce", e.function.value, e.low, e.high, body, condition_content)
            case _:
                parts = (self.expression(child, loop) for child in ir.children(e))
                return self._table.number(type(e).__name__, *_attributes(e), *parts)

    def _let(self, name: str) -> int:
        if name not in self._let_contents:
            expression = self._lets[name].expression
            content = self.expression(expression)
            remembers = any(isinstance(x, ir.MemoryCall) for x in ir.subexpressions(expression))
            self._let_contents[name] = self._table.number("let", content) if remembers else content
        return self._let_contents[name]

    def _local(self, name: str) -> int:
        if name not in self._let_contents:
            self._let_contents[name] = self.expression(self._lets[name].expression)
        return self._let_contents[name]

    # --- needed sensors --------------------------------------------------------------------------

    def needs(self, module: AnyModule) -> frozenset[str]:
        """Return the sensors without which a module is silent, or blind if it is failsafe."""
        if module.name not in self._module_needs:
            needed = (self.needed_sensors(e) for e in expressions_of(module))
            self._module_needs[module.name] = frozenset[str]().union(*needed)
        return self._module_needs[module.name]

    def needed_sensors(self, e: ir.Expression) -> frozenset[str]:
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
    table = Table()
    pair = Contents(a, table), Contents(b, table)
    classes = 0
    while len(pair[0].colors() | pair[1].colors()) > classes:
        classes = len(pair[0].colors() | pair[1].colors())
        for program_contents in pair:
            program_contents.refine()
    return pair


def _attributes(e: ir.Expression) -> tuple[Hashable, ...]:
    """Return the attributes of a node other than its operands."""
    match e:
        case ir.UnaryOperation(operator=operator):
            return (operator.value,)
        case ir.BinaryOperation(operator=operator):
            return (operator.value,)
        case ir.Slice(indices=indices):
            return (indices,)
        case ir.Window(reach=reach):
            return (reach,)
        case ir.Call(function=function):
            return (function.value,)
        case ir.MemoryCall(function=function, duration_ns=duration_ns):
            return (function.value, duration_ns)
        case ir.SentField(actuator=actuator, field_index=i):
            return (actuator, i)
        case ir.WonBy(actuator=actuator, module=module):
            return (actuator, module)
        case ir.IsCommanded(actuator=name) | ir.IsIdle(actuator=name) | ir.IsActive(name=name):
            return (name,)
        case _:
            return ()


def _value_key(value: Value) -> str:
    """Return a key of a value that distinguishes true from 1, and 0 from -0."""
    return repr(value)
