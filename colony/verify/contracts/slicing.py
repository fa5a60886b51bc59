"""Slices (Weiser, 1981): the part of a program that contracts depend on, as a program of its own.

What is drawn for a slice does not depend on declarations that have nothing to do with the contract.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import z3

from colony.ir import expression as ir
from colony.ir.program import Chain, Contract, Module, Program, Wiring
from colony.ir.walk import expressions_of, expressions_of_derived
from colony.verify.symbolic import unrolling
from colony.verify.symbolic.system import ContractFormula, ExtendedReal, Scalar, System
from colony.verify.symbolic.unrolling import Cone

# --- cone ---------------------------------------------------------------------------------------------
#
# The cone of influence of a contract: what is proved about the cone holds for the whole system.
#
# Nothing outside the cone can make the contract true or false: definitions give each auxiliary constant a
# value, whatever the values of the others, and sensors are independent of each other.


def cone_of(system: System, *claims: ContractFormula) -> Cone:
    """Return the cone of contracts; time is in every cone."""
    return unrolling.cone(system, [*(c.holds for c in claims), system.now, system.begun, system.last])


def covers(cone: Cone, other: Cone) -> bool:
    """Return True if `other` depends on nothing outside `cone`."""
    return other.leaves <= cone.leaves


def within(cone: Cone, term: z3.ExprRef) -> bool:
    """Return True if a term is part of a cone."""
    return term.get_id() in cone.visited


def facts(cone: Cone) -> z3.BoolRef:
    """Return all that holds for a frame of a run as one formula, which is faster to rename."""
    return z3.And(*cone.assumptions, *cone.definitions, *cone.invariants)


def formulas_of(scalar: Scalar) -> tuple[z3.ExprRef, ...]:
    """Return the formulas that make up a value."""
    if isinstance(scalar, ExtendedReal):
        return (scalar.value, scalar.nan, scalar.infinite)
    return (scalar,)


# --- slicing ------------------------------------------------------------------------------------------


def slice_of(program: Program, *contracts: Contract) -> Program:
    """Return the program without its tests, other contracts, and all that these do not depend on."""
    values, parts = _Dependencies(program).behind(c.expression for c in contracts)
    robot = replace(
        program.robot,
        sensors=tuple(s for s in program.robot.sensors if s.name in values),
        actuators=tuple(a for a in program.robot.actuators if a.name in parts),
    )
    return replace(
        program,
        robot=robot,
        derived=tuple(d for d in program.derived if d.name in values),
        modules=tuple(m for m in program.modules if m.name in parts),
        wires=tuple(w for w in program.wires if (w.actuator or w.name) in parts),
        limits=tuple(limit for limit in program.limits if limit.actuator in parts),
        contracts=contracts,
        tests=(),
    )


class SliceNeeds(NamedTuple):
    """Names in both name spaces: of sensors and derived values, and of modules, wires and actuators."""

    values: frozenset[str]
    parts: frozenset[str]

    def covers(self, other: SliceNeeds) -> bool:
        """Return True if all that `other` names is among these names."""
        return other.values <= self.values and other.parts <= self.parts


def needs_of_slices(program: Program) -> dict[str, SliceNeeds]:
    """Return, by contract, the names of all that its slice declares."""
    dependencies = _Dependencies(program)
    return {c.name: dependencies.behind([c.expression]) for c in program.contracts}


class _Dependencies:
    """What the declarations of a program depend on. Mutable: each is walked when first asked for."""

    def __init__(self, program: Program) -> None:
        self._senders = {
            s.name: s.sent.actuator if s.sent is not None else None for s in program.robot.sensors
        }
        self._derived = {d.name: d for d in program.derived}
        self._modules = {m.name: m for m in program.modules}
        self._owners = {
            declared.name: m.name
            for m in program.modules
            if isinstance(m, Module)
            for declared in (*m.lets, *m.states)
        }
        self._wirings = {w.actuator or w.name: w.wiring for w in program.wires}
        self._limits = program.limits
        self._behind_value: dict[str, SliceNeeds] = {}
        self._behind_part: dict[str, SliceNeeds] = {}

    def behind(self, expressions: Iterable[ir.Expression]) -> SliceNeeds:
        """Return all that expressions depend on."""
        values, parts = set[str](), set[str]()
        pending = [self._of(expressions)]
        while pending:
            found = pending.pop()
            pending += [self._of_value(name) for name in found.values - values]
            pending += [self._of_part(name) for name in found.parts - parts]
            values |= found.values
            parts |= found.parts
        return SliceNeeds(frozenset(values), frozenset(parts))

    def _of(self, expressions: Iterable[ir.Expression], *more: str | None) -> SliceNeeds:
        """Return what expressions name, besides `more` parts."""
        values, parts = set[str](), {name for name in more if name is not None}
        for expression in expressions:
            for node in ir.subexpressions(expression):
                match node:
                    case ir.SensorValue(name=name) | ir.Fresh(name=name):
                        values.add(name)
                    case ir.DerivedValue(name=name) | ir.StateValue(name=name) | ir.LocalValue(name=name):
                        if name in self._owners:
                            parts.add(self._owners[name])
                        else:
                            values.add(name)
                    case (
                        ir.SentField(actuator=name)
                        | ir.WonBy(actuator=name)
                        | ir.IsCommanded(actuator=name)
                        | ir.IsIdle(actuator=name)
                        | ir.IsActive(name=name)
                    ):
                        parts.add(name)
                    case _:
                        pass
        return SliceNeeds(frozenset(values), frozenset(parts))

    def _of_value(self, name: str) -> SliceNeeds:
        """Return what a sensor or derived value is computed from."""
        if name not in self._behind_value:
            self._behind_value[name] = (
                self._of(expressions_of_derived(self._derived[name]))
                if name in self._derived
                else self._of((), self._senders[name])
            )
        return self._behind_value[name]

    def _of_part(self, name: str) -> SliceNeeds:
        """Return what a module, wire or actuator is computed from."""
        if name not in self._behind_part:
            self._behind_part[name] = self._compute(name)
        return self._behind_part[name]

    def _compute(self, name: str) -> SliceNeeds:
        if name in self._modules:
            module = self._modules[name]
            return self._of(expressions_of(module), module.actuator)
        limits = [limit for limit in self._limits if limit.actuator == name]
        read = [e for x in limits for e in (x.bound, x.condition) if e is not None]
        return self._of(read, *(_uses(self._wirings[name]) if name in self._wirings else ()))


def _uses(wiring: Wiring) -> Iterable[str]:
    if isinstance(wiring, Chain):
        return [name for operand in wiring.operands for name in _uses(operand)]
    return [wiring.name]
