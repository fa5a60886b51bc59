"""Slices (Weiser, 1981): the part of a program that contracts depend on, as a program of its own.

What is drawn for a slice does not depend on declarations that have nothing to do with the contract.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

from colony.ir import expression as ir
from colony.ir.program import Chain, Contract, Module, Program, Wire, Wiring
from colony.ir.walk import expressions_of, expressions_of_derived


def slice_of(program: Program, *contracts: Contract) -> Program:
    """Return the program without its tests, other contracts, and all that these do not depend on."""
    names, actuators = _Dependencies(program).behind(c.expression for c in contracts)
    robot = replace(
        program.robot,
        sensors=tuple(s for s in program.robot.sensors if s.name in names),
        actuators=tuple(a for a in program.robot.actuators if a.name in actuators),
    )

    def is_needed(wire: Wire) -> bool:
        return wire.name in names if wire.actuator is None else wire.actuator in actuators

    return replace(
        program,
        robot=robot,
        derived=tuple(d for d in program.derived if d.name in names),
        modules=tuple(m for m in program.modules if m.name in names),
        wires=tuple(w for w in program.wires if is_needed(w)),
        limits=tuple(limit for limit in program.limits if limit.actuator in actuators),
        contracts=contracts,
        tests=(),
    )


def names_of_slices(program: Program) -> dict[str, frozenset[str]]:
    """Return, by contract, the names of all that its slice declares."""
    dependencies = _Dependencies(program)
    return {c.name: frozenset().union(*dependencies.behind([c.expression])) for c in program.contracts}


class _Needs(NamedTuple):
    """Names of sensors, derived values, modules and wires, and of actuators."""

    names: frozenset[str]
    actuators: frozenset[str]


class _Dependencies:
    """What the declarations of a program depend on. Mutable: each is walked when first asked for."""

    def __init__(self, program: Program) -> None:
        self._sensors = {s.name: s for s in program.robot.sensors}
        self._derived = {d.name: d for d in program.derived}
        self._modules = {m.name: m for m in program.modules}
        self._owners = {
            declared.name: m.name
            for m in program.modules
            if isinstance(m, Module)
            for declared in (*m.lets, *m.states)
        }
        self._wires = {w.name: w for w in program.wires if w.actuator is None}
        self._wirings = {w.actuator: w for w in program.wires if w.actuator is not None}
        self._limits = program.limits
        self._direct: dict[tuple[str, bool], _Needs] = {}  # by name, and whether it is an actuator

    def behind(self, expressions: Iterable[ir.Expression]) -> _Needs:
        """Return all that expressions depend on."""
        names, actuators = set[str](), set[str]()
        pending = [self._of(expressions)]
        while pending:
            found = pending.pop()
            pending += [self._of_name(name) for name in found.names - names]
            pending += [self._of_actuator(name) for name in found.actuators - actuators]
            names |= found.names
            actuators |= found.actuators
        return _Needs(frozenset(names), frozenset(actuators))

    def _of(self, expressions: Iterable[ir.Expression], *more: str, actuator: str | None = None) -> _Needs:
        """Return what expressions name, besides `more` names and an actuator."""
        names, actuators = {*more}, {actuator} if actuator is not None else set()
        for expression in expressions:
            for node in ir.subexpressions(expression):
                match node:
                    case ir.SensorValue(name=name) | ir.Fresh(name=name) | ir.IsActive(name=name):
                        names.add(name)
                    case ir.DerivedValue(name=name) | ir.StateValue(name=name) | ir.LocalValue(name=name):
                        names.add(self._owners.get(name, name))
                    case (
                        ir.SentField(actuator=sent)
                        | ir.WonBy(actuator=sent)
                        | ir.IsCommanded(actuator=sent)
                        | ir.IsIdle(actuator=sent)
                    ):
                        actuators.add(sent)
                    case _:
                        pass
        return _Needs(frozenset(names), frozenset(actuators))

    def _of_name(self, name: str) -> _Needs:
        """Return what a sensor, derived value, module or wire is computed from."""
        if (name, False) not in self._direct:
            self._direct[name, False] = self._compute(name)
        return self._direct[name, False]

    def _compute(self, name: str) -> _Needs:
        if name in self._sensors:
            sent = self._sensors[name].sent
            return self._of((), actuator=None if sent is None else sent[0])
        if name in self._derived:
            return self._of(expressions_of_derived(self._derived[name]))
        if name in self._modules:
            module = self._modules[name]
            return self._of(expressions_of(module), actuator=module.actuator)
        return self._of((), *_uses(self._wires[name].wiring))

    def _of_actuator(self, name: str) -> _Needs:
        if (name, True) not in self._direct:
            limits = [limit for limit in self._limits if limit.actuator == name]
            read = [e for x in limits for e in (x.bound, x.condition) if e is not None]
            uses = _uses(self._wirings[name].wiring) if name in self._wirings else ()
            self._direct[name, True] = self._of(read, *uses)
        return self._direct[name, True]


def _uses(wiring: Wiring) -> Iterable[str]:
    if isinstance(wiring, Chain):
        return [name for operand in wiring.operands for name in _uses(operand)]
    return [wiring.name]
