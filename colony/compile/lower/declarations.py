"""Lowering of lets, states, machines and modules to ops, each on first use.

Lets are lowered before the expressions that read them, so that nothing recurses over chains of lets.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import assert_never

from colony.compile.guards import ClientList
from colony.compile.lower.builder import CodeBuilder
from colony.compile.lower.expressions import ExpressionLowering, LoweringScope, Values, kind_of
from colony.compile.lower.memory import GuardLowering
from colony.execute.code import Kind, Lost, PythonActive, PythonBlind, SensorFresh
from colony.execute.operators import Operator
from colony.ir import expression as e
from colony.ir import program as ir
from colony.ir.memory import state_cell


@dataclass(frozen=True, slots=True)
class _OwnedLet:
    let: ir.Let
    module: ir.Module | None


@dataclass(frozen=True, slots=True)
class _OwnedState:
    state: ir.State
    module: ir.Module | None


@dataclass(frozen=True, slots=True)
class _Undecided:
    """A transition from `sources` that reads something missing, under `condition`, unless `needs` hold."""

    sources: frozenset[float]
    needs: frozenset[int]
    condition: int

    def can_block(self, sources: frozenset[float], needs: frozenset[int]) -> bool:
        """Return True if it can keep a transition below it, which has all that it needs, from being taken."""
        return bool(self.sources & sources) and not self.needs <= needs


class Declarations:
    """The lets, states and modules of a program, each lowered on first use. Mutable.

    It implements `Names`: it resolves the names in the expressions being lowered.
    """

    def __init__(self, program: ir.Program, clients: ClientList) -> None:
        self.program = program
        self.builder = CodeBuilder()
        self.expressions = ExpressionLowering(self.builder, self)
        self._sensors = {s.name: s for s in program.robot.sensors}
        self.actuators = {a.name: a for a in program.robot.actuators}
        self.modules = {m.name: m for m in program.modules}
        self.guards = GuardLowering(self.builder, clients, self.module_active)
        self._all_lets = dict(self._lets_of(program))
        self._all_states = dict(self._states_of(program))
        self._lets: dict[str, Values] = {}
        self._let_present: dict[str, int] = {}
        self._states: dict[str, int] = {}
        self._states_to_update: list[str] = []
        self._present: dict[str, int] = {}
        self._active: dict[str, int] = {}

    @staticmethod
    def _lets_of(program: ir.Program) -> Iterator[tuple[str, _OwnedLet]]:
        for derived in program.derived:
            if isinstance(derived, ir.Let):
                yield derived.name, _OwnedLet(derived, None)
        for module in program.modules:
            if isinstance(module, ir.Module):
                for let in module.lets:
                    yield let.name, _OwnedLet(let, module)

    @staticmethod
    def _states_of(program: ir.Program) -> Iterator[tuple[str, _OwnedState | ir.Machine]]:
        for derived in program.derived:
            match derived:
                case ir.State():
                    yield derived.name, _OwnedState(derived, None)
                case ir.Machine():
                    yield derived.name, derived
                case ir.Let():
                    pass
                case _:
                    assert_never(derived)
        for module in program.modules:
            if isinstance(module, ir.Module):
                for state in module.states:
                    yield state.name, _OwnedState(state, module)

    # --- names -----------------------------------------------------------------------------------

    def sensor_kind(self, sensor: str) -> Kind:
        """Return the kind of a sensor's value or elements."""
        return kind_of(self._sensors[sensor].type)

    def sensor_present(self, sensor: str) -> int:
        """Return the condition that a sensor has a value, its default included."""
        if self._sensors[sensor].default is not None:
            return self.builder.literal(True)
        return self.builder.add(SensorFresh(sensor), Kind.BOOL)

    def let(self, name: str) -> Values:
        """Return the values of a let."""
        return self._lets[name]

    def let_present(self, name: str) -> int:
        """Return the condition that a file-level let is not missing."""
        return self._let_present[name]

    def module_of_let(self, name: str) -> str:
        """Return the name of the module that a let belongs to."""
        module = self._all_lets[name].module
        assert module is not None
        return module.name

    def has_idle_command(self, actuator: str) -> bool:
        """Return True if the actuator has an idle command, False for `idle hold`."""
        return self.actuators[actuator].idle is not None

    def field_kind(self, actuator: str, index: int) -> Kind:
        """Return the kind of a field of an actuator."""
        return kind_of(self.actuators[actuator].fields[index].type)

    def state(self, name: str) -> int:
        """Return the old value of a state or machine, and record that it must be updated."""
        if name not in self._states:
            declaration = self._all_states[name]
            if isinstance(declaration, ir.Machine):
                old = self.builder.cell(name, Kind.NUMBER, declaration.start, state_cell(name))
                self._states_to_update.append(name)
            elif declaration.state.next is None:
                old = self.builder.literal(declaration.state.initial)
            else:
                kind = kind_of(declaration.state.type)
                old = self.builder.cell(name, kind, declaration.state.initial, state_cell(name))
                self._states_to_update.append(name)
            self._states[name] = old
        return self._states[name]

    def active(self, name: str) -> int:
        """Return the condition that a module, or a wire that a contract names, is active."""
        if name in self.modules:
            return self.module_active(name)
        return self.guards.guard(self.guards.activity_guards[name])

    # --- derived values --------------------------------------------------------------------------

    def prepare(self, *expressions: e.Expression) -> None:
        """Lower the lets that the expressions read, dependencies first."""
        if not self._all_lets:
            return
        pending = [name for expression in expressions for name in _lets_read(expression)]
        while pending:
            name = pending[-1]
            if name in self._lets:
                pending.pop()
                continue
            dependencies = [n for n in _lets_read(self._all_lets[name].let.expression) if n not in self._lets]
            if dependencies:
                pending.extend(dependencies)
            else:
                pending.pop()
                self._let(self._all_lets[name])

    def _let(self, owned: _OwnedLet) -> None:
        let = owned.let
        if owned.module is None:
            scope = self.file_scope(let.name, (let.expression,))
            self._let_present[let.name] = scope.ready
        else:
            scope = self.module_scope(owned.module, let.name)
        values = self._lets[let.name] = self.expressions.lower(let.expression, scope)
        for i, value in enumerate(values):
            self.builder.names.setdefault(value, let.name if len(values) == 1 else f"{let.name}_{i}")

    def states(self) -> None:
        """Lower the next values of all states read so far; these may read further states."""
        while self._states_to_update:
            name = self._states_to_update.pop()
            declaration = self._all_states[name]
            if isinstance(declaration, ir.Machine):
                self._machine(declaration)
            elif declaration.state.next is not None:
                self._state(declaration.state, declaration.state.next, declaration.module)

    def _state(self, state: ir.State, next_value: e.Expression, module: ir.Module | None) -> None:
        self.prepare(next_value)
        if module is None:
            scope = self.file_scope(state.name, (next_value,))
        else:
            scope = self.module_scope(module, state.name)
        self.builder.keep(self._states[state.name], scope.ready, self.expressions.scalar(next_value, scope))

    def _machine(self, machine: ir.Machine) -> None:
        """Take the first transition from the current phase that applies (see `ir.Machine`)."""
        builder, old = self.builder, self._states[machine.name]
        phases = frozenset(number for _, number in machine.type.members)
        transitions: list[tuple[int, int]] = []
        above: list[_Undecided] = []
        for i, transition in enumerate(machine.transitions):
            self.prepare(transition.condition)
            scope = self.file_scope(f"{machine.name} {i}", (transition.condition,))
            condition = self.expressions.scalar(transition.condition, scope)
            in_source = self._in_phase(old, transition.sources, phases)
            missing = builder.negation(scope.ready)
            if transition.failsafe:
                applies = builder.both(in_source, builder.either(missing, condition))
            else:
                needs = builder.conjuncts(scope.ready)
                blocking = (x.condition for x in above if x.can_block(transition.sources, needs))
                applies = builder.both(in_source, scope.ready, condition, *map(builder.negation, blocking))
                undecided = builder.both(in_source, missing)
                above.append(_Undecided(transition.sources, needs, undecided))
            transitions.append((applies, builder.literal(transition.target)))
        next_phase = old
        for applies, target in reversed(transitions):
            next_phase = builder.apply(Operator.SELECT, applies, target, next_phase)
        builder.keep(old, builder.either(*[applies for applies, _ in transitions]), next_phase)

    def _in_phase(self, old: int, sources: frozenset[float], phases: frozenset[float]) -> int:
        builder = self.builder
        others = phases - sources
        if len(others) == 1:
            return builder.apply(Operator.NOT_EQUAL, old, builder.literal(*others))
        tests = [builder.apply(Operator.EQUAL, old, builder.literal(s)) for s in sorted(sources)]
        return builder.either(*tests)

    def file_scope(self, label: str, expressions: tuple[e.Expression, ...]) -> LoweringScope:
        """Return the scope of file-level expressions; `label` is the prefix of the names of their cells."""
        return LoweringScope(owner=None, label=label, ready=self.expressions.present(expressions, None))

    # --- modules ---------------------------------------------------------------------------------

    def module_present(self, module: str) -> int:
        """Return the condition that everything the module reads is present."""
        if module not in self._present:
            expressions = _all_expressions(self.modules[module])
            if self._all_lets:
                self.prepare(*[read for x in expressions for read in _file_lets_read(x)])
            self._present[module] = self.expressions.present(expressions, module)
        return self._present[module]

    def module_scope(self, module: ir.Module, label: str) -> LoweringScope:
        """Return the scope of a module's expressions; `label` is the prefix of the names of their cells."""
        return LoweringScope(owner=module.name, label=label, ready=self.module_present(module.name))

    def module_active(self, name: str) -> int:
        """Return the condition that the module puts a command on its output."""
        if name not in self._active:
            module = self.modules[name]
            match module:
                case ir.Module():
                    scope = self.module_scope(module, name)
                    self.prepare(module.when)
                    applicable = self.expressions.scalar(module.when, scope)
                    active = self.builder.both(scope.ready, applicable)
                case ir.PythonModule():
                    active = self.builder.add(PythonActive(name), Kind.BOOL)
                case _:
                    assert_never(module)
            active = self.builder.either(active, self.builder.negation(self.module_known(name)))
            self.builder.names.setdefault(active, f"{name} active")
            self._active[name] = active
        return self._active[name]

    def module_known(self, name: str) -> int:
        """Return the condition that the module is not a failsafe one that is blind."""
        module = self.modules[name]
        if not module.failsafe:
            return self.builder.literal(True)
        match module:
            case ir.Module():
                return self.module_present(name)
            case ir.PythonModule():
                return self.builder.negation(self.builder.add(PythonBlind(name), Kind.BOOL))
            case _:
                assert_never(module)

    def observes(self, expression: e.Expression) -> bool:
        """Return True if an expression reads the activity of a wire."""
        return any(
            isinstance(node, e.IsActive) and node.name not in self.modules for node in _walk(expression)
        )

    def active_unless_lost(self, module: str) -> int:
        """Return the module's activity under `on_loss degrade`: a lost client is not active.

        A failsafe one is: others keep away as if it were there, and the actuator idles where it would win.
        """
        active = self.module_active(module)
        if self.modules[module].actuator is None or self.modules[module].failsafe:
            return active
        return self.builder.both(active, self.builder.negation(self.builder.add(Lost(module), Kind.BOOL)))


# --- what expressions read -----------------------------------------------------------------------


def _all_expressions(module: ir.AnyModule) -> tuple[e.Expression, ...]:
    """Return all expressions of a module: it needs everything that they read."""
    match module:
        case ir.Module():
            return (
                *(let.expression for let in module.lets),
                *(state.next for state in module.states if state.next is not None),
                module.when,
                *(module.command.fields if module.command else ()),
            )
        case ir.PythonModule():
            return tuple(r.expression for r in module.reads)
        case _:
            assert_never(module)


def _walk(expression: e.Expression) -> Iterator[e.Expression]:
    pending = [expression]
    while pending:
        node = pending.pop()
        yield node
        pending.extend(e.children(node))


def _lets_read(expression: e.Expression) -> list[str]:
    """Return all lets, of files and of modules, that an expression reads."""
    return [
        node.name
        for node in _walk(expression)
        if isinstance(node, e.DerivedValue | e.LocalValue) or (isinstance(node, e.Fresh) and node.derived)
    ]


def _file_lets_read(expression: e.Expression) -> list[e.Expression]:
    return [
        node
        for node in _walk(expression)
        if isinstance(node, e.DerivedValue) or (isinstance(node, e.Fresh) and node.derived)
    ]
