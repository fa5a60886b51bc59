"""Coverage, calculated a second time: by what the interpreter says of the program as it is written.

Conditions are covered by brute force over pairs of frames. Their values are those that the interpreter
computes on the way to the outcome of a decision. A condition decides where its opposite alone changes the
outcome.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import pytest

from colony.ir import expression as ir
from colony.ir.expression import Binary, Expression, rebuilt
from colony.ir.frame import Frame
from colony.ir.program import Let, Machine, Module, Program
from colony.ir.types import Bool
from colony.ir.walk import WiringNode, wiring_graph
from colony.verify.claims import negation
from colony.verify.reference import expressions, interpreter
from colony.verify.reference.interpreter import Interpreter

Key = tuple[str, str, str]
"""Kind, subject, and text of an obligation; of a condition, its number in the decision."""

Vector = tuple[bool, ...]


def covered(program: Program, frames: Iterable[Frame], patch: pytest.MonkeyPatch) -> set[Key]:
    """Return what a run covers of modules, nodes, conditions, machines, sensors and contracts."""
    program = _with_own_nodes(program)
    premises = {
        c.name: replace(c, expression=negation(e.left), in_time=False)
        for c in program.contracts
        if isinstance(e := c.expression, ir.BinaryOperation) and e.operator is Binary.IMPLIES
    }
    program = replace(program, contracts=tuple(premises.values()))
    values: dict[int, Any] = {}
    evaluate = expressions.evaluate

    def recording(e: Expression, *more: Any) -> Any:
        value = values[id(e)] = evaluate(e, *more)
        return value

    patch.setattr(expressions, "evaluate", recording)
    patch.setattr(interpreter, "evaluate", recording)
    executor = Interpreter(program)
    vectors: dict[str, tuple[Expression, set[Vector]]] = {}
    found: set[Key] = set()
    nodes = wiring_graph(program)
    before = executor.states
    for frame in frames:
        values.clear()
        breaches = executor.step(frame).breaches
        found.update(("contract", name, "") for name in breaches if not executor.is_unknown(name))
        found.update(_of_modules(program, executor))
        found.update(_of_sensors(program, executor))
        outputs = {n.name: executor.node_output(str(n.path[0]), n.path[1:]) for n in nodes.nodes}
        found.update(k for n in nodes.nodes for k in _of_node(n, outputs, executor))
        for owner, e in _decisions(program, before, values):
            atoms = _atoms(e)
            if all(id(a) in values for a in atoms):
                vectors.setdefault(owner, (e, set()))[1].add(tuple(bool(values[id(a)]) for a in atoms))
        for machine in _machines(program):
            phase = next(name for name, n in machine.type.members if n == before[machine.name])
            found.add(("machine", machine.name, phase))
        before = dict(executor.states)
    for owner, (e, seen) in vectors.items():
        found.update(("condition", owner, str(i)) for i in _decided(e, seen))
    return found


def _of_modules(program: Program, executor: Interpreter) -> Iterator[Key]:
    for m in program.modules:
        if executor.is_active(m.name):
            wins = executor.values.winners.get(m.actuator or "") == m.name
            yield ("module", m.name, "active")
            yield ("module", m.name, "wins" if wins else "dominated")
        if isinstance(m, Module) and executor.is_blind(m.name):
            yield ("module", m.name, "blind")


def _of_sensors(program: Program, executor: Interpreter) -> Iterator[Key]:
    return (("sensor", s.name, "missing") for s in program.robot.sensors if not executor.is_read(s.name))


def _of_node(node: WiringNode, outputs: Mapping[str, str | None], executor: Interpreter) -> Iterator[Key]:
    dominant, inferior = (
        outputs[n] is not None if n in outputs else executor.is_active(n)
        for n in (node.dominant, node.inferior)
    )
    passes = outputs[node.name] is not None
    if node.relation == "suppresses" and dominant:
        yield ("node", node.name, "dominant side")
    if node.relation == "inhibits" and dominant and inferior:
        yield ("node", node.name, "inhibits")
    if passes and not dominant:
        yield ("node", node.name, "inferior side")
    if inferior and not dominant and not passes:
        yield ("node", node.name, "time constant")


# --- decisions -----------------------------------------------------------------------------------------


def _machines(program: Program) -> Iterator[Machine]:
    return (d for d in program.derived if isinstance(d, Machine))


def _decisions(
    program: Program, before: Mapping[str, Any], values: Mapping[int, Any]
) -> Iterator[tuple[str, Expression]]:
    """Yield the decisions that count in a frame."""
    for d in program.derived:
        if isinstance(d, Let) and isinstance(d.expression.type, Bool) and len(_atoms(d.expression)) > 0:
            yield d.name, d.expression
        if isinstance(d, Machine):
            phase, done, held = before[d.name], False, False
            for i, t in enumerate(d.transitions):
                if phase not in t.sources:
                    continue
                known = id(t.condition) in values
                if not done and (t.failsafe or not held):
                    yield f"{d.name} {i}", t.condition
                    done = bool(values[id(t.condition)]) if known else t.failsafe
                held = held or not (known or t.failsafe)
    for i, limit in enumerate(program.limits):
        if limit.condition is not None and _parts(limit.condition) is not None:
            yield f"limit {i}", limit.condition
    for m in program.modules:
        if isinstance(m, Module) and id(m.when) in values:
            yield from ((let.name, let.expression) for let in m.lets if isinstance(let.expression.type, Bool))
            yield m.name, m.when
            if m.command is not None:
                fields = next(a.fields for a in program.robot.actuators if a.name == m.actuator)
                for field, e in zip(fields, m.command.fields, strict=True):
                    if _parts(e) is not None:
                        yield f"{m.name}: {m.actuator}.{field.name}", e


def _parts(e: Expression) -> tuple[Expression, ...] | None:
    """Return the operands of a decision, None for a condition."""
    if not isinstance(e.type, Bool):
        return None
    if isinstance(e, ir.Conditional):
        return e.condition, e.yes, e.no
    if isinstance(e, ir.UnaryOperation):
        return (e.operand,)
    if isinstance(e, ir.BinaryOperation) and e.operator in (Binary.AND, Binary.OR, Binary.IMPLIES):
        return e.left, e.right
    return None


def _atoms(e: Expression) -> list[Expression]:
    parts = _parts(e)
    if parts is not None:
        return [a for p in parts for a in _atoms(p)]
    return [] if isinstance(e, ir.Constant) else [e]


def _outcome(e: Expression, vector: Iterator[bool]) -> bool:
    """Return the outcome of a decision by the values of its conditions, in order."""
    parts = _parts(e)
    if parts is None:
        return bool(e.value) if isinstance(e, ir.Constant) else next(vector)
    known = [_outcome(p, vector) for p in parts]
    match e:
        case ir.Conditional():
            return known[1] if known[0] else known[2]
        case ir.UnaryOperation():
            return not known[0]
        case ir.BinaryOperation(operator=Binary.AND):
            return known[0] and known[1]
        case ir.BinaryOperation(operator=Binary.OR):
            return known[0] or known[1]
        case _:
            return not known[0] or known[1]


def _decided(e: Expression, seen: set[Vector]) -> Iterator[int]:
    """Yield the numbers of the conditions that a pair of frames covers."""

    def outcome(v: Vector) -> bool:
        return _outcome(e, iter(v))

    for i in range(len(_atoms(e))):
        deciding = [v for v in seen if outcome(v) != outcome((*v[:i], not v[i], *v[i + 1 :]))]
        if any(a[i] != b[i] and outcome(a) != outcome(b) for a, b in product(deciding, repeat=2)):
            yield i


def _with_own_nodes(program: Program) -> Program:
    """Return the program in which no two declarations share a part of an expression."""

    def copy(e: Expression) -> Expression:
        return replace(rebuilt(e, copy))

    def module(m: Module) -> Module:
        lets = tuple(replace(let, expression=copy(let.expression)) for let in m.lets)
        command = m.command and replace(m.command, fields=tuple(map(copy, m.command.fields)))
        return replace(m, when=copy(m.when), lets=lets, command=command)

    derived: list[Any] = []
    for d in program.derived:
        if isinstance(d, Let):
            d = replace(d, expression=copy(d.expression))
        elif isinstance(d, Machine):
            transitions = tuple(replace(t, condition=copy(t.condition)) for t in d.transitions)
            d = replace(d, transitions=transitions)
        derived.append(d)
    limits = tuple(replace(x, condition=x.condition and copy(x.condition)) for x in program.limits)
    modules = tuple(module(m) if isinstance(m, Module) else m for m in program.modules)
    return replace(program, derived=tuple(derived), limits=limits, modules=modules)
