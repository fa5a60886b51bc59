"""Slices (Weiser, 1981): the part of a program that a contract depends on, as a program of its own.

What is drawn for a slice does not depend on declarations that have nothing to do with the contract.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from colony.ir import expression as ir
from colony.ir.program import Chain, Contract, Module, Program, Wire, Wiring
from colony.ir.walk import expressions_of, expressions_of_derived


def slice_of(program: Program, contract: Contract) -> Program:
    """Return the program without its tests, other contracts, and all that the contract does not depend on."""
    needed = _Needed(program)
    needed.add(contract.expression)
    robot = replace(
        program.robot,
        sensors=tuple(s for s in program.robot.sensors if s.name in needed.names),
        actuators=tuple(a for a in program.robot.actuators if a.name in needed.actuators),
    )
    return replace(
        program,
        robot=robot,
        derived=tuple(d for d in program.derived if d.name in needed.names),
        modules=tuple(m for m in program.modules if m.name in needed.names),
        wires=tuple(w for w in program.wires if _is_needed(w, needed)),
        limits=tuple(limit for limit in program.limits if limit.actuator in needed.actuators),
        contracts=(contract,),
        tests=(),
    )


def _is_needed(wire: Wire, needed: _Needed) -> bool:
    return wire.name in needed.names if wire.actuator is None else wire.actuator in needed.actuators


class _Needed:
    """The names that expressions depend on, through declarations. Mutable.

    `names` are those of sensors, derived values, modules and wires; `actuators` those of actuators.
    """

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
        self.names: set[str] = set()
        self.actuators: set[str] = set()

    def add(self, expression: ir.Expression) -> None:
        """Add all that an expression depends on."""
        pending = [expression]
        while pending:
            for node in ir.subexpressions(pending.pop()):
                pending.extend(self._read_by(node))

    def _read_by(self, node: ir.Expression) -> Iterator[ir.Expression]:
        match node:
            case ir.SensorValue(name=name) | ir.Fresh(name=name):
                yield from self._name(name)
            case ir.DerivedValue(name=name) | ir.StateValue(name=name) | ir.LocalValue(name=name):
                yield from self._name(self._owners.get(name, name))
            case ir.IsActive(name=name):
                yield from self._name(name)
            case (
                ir.SentField(actuator=actuator)
                | ir.WonBy(actuator=actuator)
                | ir.IsCommanded(actuator=actuator)
                | ir.IsIdle(actuator=actuator)
            ):
                yield from self._actuator(actuator)
            case _:
                pass

    def _name(self, name: str) -> Iterator[ir.Expression]:
        """Add a sensor, derived value, module or wire; yield the expressions that it is computed from."""
        if name in self.names:
            return
        self.names.add(name)
        if name in self._sensors:
            sent = self._sensors[name].sent
            yield from () if sent is None else self._actuator(sent[0])
        elif name in self._derived:
            yield from expressions_of_derived(self._derived[name])
        elif name in self._modules:
            module = self._modules[name]
            yield from expressions_of(module)
            yield from () if module.actuator is None else self._actuator(module.actuator)
        else:
            yield from self._used(self._wires[name].wiring)

    def _actuator(self, name: str) -> Iterator[ir.Expression]:
        if name in self.actuators:
            return
        self.actuators.add(name)
        if name in self._wirings:
            yield from self._used(self._wirings[name].wiring)
        for limit in self._limits:
            if limit.actuator == name:
                yield limit.bound
                yield from () if limit.condition is None else (limit.condition,)

    def _used(self, wiring: Wiring) -> Iterator[ir.Expression]:
        for name in _uses(wiring):
            yield from self._name(name)


def _uses(wiring: Wiring) -> Iterable[str]:
    if isinstance(wiring, Chain):
        return [name for operand in wiring.operands for name in _uses(operand)]
    return [wiring.name]
