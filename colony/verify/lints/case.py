"""The subject of the lints: a program whose nodes and commands have names, and facts about it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from colony.ir import expression as ir
from colony.ir.program import Actuator, ActuatorField, AnyModule, Derived, Let, Machine, Module, Program
from colony.ir.types import BOOL, ScalarValue
from colony.text.source import Source, Span
from colony.verify.difference.content import Contents
from colony.verify.difference.table import Table
from colony.verify.lints.bounds import with_named_bounds
from colony.verify.lints.network import NamedNetwork, network

_READING = (ir.SensorValue, ir.DerivedValue, ir.LocalValue, ir.StateValue, ir.Fresh, ir.Restarted)


@dataclass(frozen=True, slots=False, kw_only=True)
class Case:
    """The subject of the lints.

    `instrumented` is `program` without contracts and tests, but with a wire for each node and a let for each
    field of a module's command (`command_of`), each condition of a machine (`condition_of`) and each bound of
    a limit, so that claims can name them.
    """

    program: Program
    instrumented: Program
    network: NamedNetwork

    @cached_property
    def contents(self) -> Contents:
        """The contents of the program's declarations."""
        return Contents(self.program, Table())

    @cached_property
    def actuators(self) -> dict[str, Actuator]:
        """The actuators by name."""
        return {a.name: a for a in self.program.robot.actuators}

    @cached_property
    def wired_modules(self) -> dict[str, AnyModule]:
        """The modules that reach an actuator, by name."""
        wired = {m for root in self.network.roots.values() for m in self.network.modules_under(root)}
        return {m.name: m for m in self.program.modules if m.name in wired}

    @cached_property
    def modules(self) -> dict[str, Module]:
        """Those of `wired_modules` that are written in the language."""
        return {name: m for name, m in self.wired_modules.items() if isinstance(m, Module)}

    @cached_property
    def main_file(self) -> Source | None:
        """The file that drives the actuators."""
        return next((w.span.source for w in self.program.wires if w.actuator is not None), None)

    def is_own(self, span: Span) -> bool:
        """Return True if a span is in the main file; findings in imported files are left out."""
        return span.source is self.main_file

    @cached_property
    def own_modules(self) -> dict[str, Module]:
        """The modules of the main file, by name."""
        return {name: m for name, m in self.modules.items() if self.is_own(m.span)}

    def reads(self, *expressions: ir.Expression) -> Iterator[ir.Expression]:
        """Yield the subexpressions of expressions and of the lets that they read."""
        pending, seen = list(expressions), set[str]()
        while pending:
            for x in ir.subexpressions(pending.pop()):
                yield x
                if isinstance(x, ir.DerivedValue | ir.LocalValue) and x.name not in seen:
                    seen.add(x.name)
                    pending.append(self._lets[x.name].expression)

    @cached_property
    def _lets(self) -> dict[str, Let]:
        of_modules = (let for m in self.program.modules if isinstance(m, Module) for let in m.lets)
        of_files = (d for d in self.program.derived if isinstance(d, Let))
        return {let.name: let for let in (*of_files, *of_modules)}

    def has_inputs(self, module: Module) -> bool:
        """Return True if a module's predicate reads anything."""
        return any(isinstance(x, _READING) for x in ir.subexpressions(module.when))


def case_of(program: Program) -> Case:
    """Return the case of a program."""
    named_network = network(program)
    modules = tuple(_instrumented(m) if isinstance(m, Module) else m for m in program.modules)
    instrumented = replace(program, modules=modules, wires=named_network.wires, contracts=(), tests=())
    instrumented = with_named_bounds(_with_named_conditions(instrumented))
    return Case(program=program, instrumented=instrumented, network=named_network)


def command_of(module: Module, i: int) -> ir.Expression:
    """Return field `i` of a module's command, as claims refer to it; missing where the module is silent."""
    assert module.command is not None
    return ir.LocalValue(type=module.command.fields[i].type, name=f"{module.name}. {i}")


def condition_of(machine: Machine, i: int) -> ir.DerivedValue:
    """Return the condition of transition `i` of a machine, as claims refer to it."""
    return ir.DerivedValue(type=BOOL, name=f"{machine.name}. {i}")


def _with_named_conditions(program: Program) -> Program:
    """Return the program with a let for the condition of each transition, which the transition reads."""
    derived: list[Derived] = []
    for item in program.derived:
        if isinstance(item, Machine):
            conditions = tuple(condition_of(item, i) for i in range(len(item.transitions)))
            pairs = tuple(zip(item.transitions, conditions, strict=True))
            derived += (Let(name=c.name, expression=t.condition) for t, c in pairs)
            item = replace(item, transitions=tuple(replace(t, condition=c) for t, c in pairs))
        derived.append(item)
    return replace(program, derived=tuple(derived))


def _instrumented(module: Module) -> Module:
    if module.command is None:
        return module
    fields = module.command.fields
    field_lets = tuple(Let(name=f"{module.name}. {i}", expression=e) for i, e in enumerate(fields))
    values = tuple(command_of(module, i) for i in range(len(fields)))
    return replace(module, lets=(*module.lets, *field_lets), command=replace(module.command, fields=values))


def value_text(x: ScalarValue, field: ActuatorField) -> str:
    """Return a value of a field in its declared unit."""
    return f"{x / field.factor:.6g}{f' {field.unit}' if field.unit else ''}"
