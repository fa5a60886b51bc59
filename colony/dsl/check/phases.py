"""Checking of a machine's phases: phases that nothing leads to, and phases that nothing leaves."""

from __future__ import annotations

from collections.abc import Iterator

from colony.dsl import ast
from colony.dsl.check.checker import Checker
from colony.dsl.check.compatibility import constant_value
from colony.ir import expression as ir
from colony.ir.program import Machine, Transition
from colony.text.diagnostics import Diagnostic, note, warning


def phase_findings(checker: Checker, node: ast.MachineDecl, machine: Machine) -> Iterator[Diagnostic]:
    """Yield a warning for each phase that nothing leads to, and a note for each that nothing leaves."""
    tasks = {task.text for task in node.tasks}
    taken = {name: _targets(machine, number) for name, number in machine.type.members}
    reached = _reached(machine, taken)
    for phase in _phases(node):
        name = phase.text
        if tasks and (name in reached or name not in tasks):
            continue
        if name not in reached:
            if tasks:
                hint = "correct the `until` of the task above, or name this one after an `else`"
            elif _is_target(node, name):
                hint = "correct the conditions of the transitions to it, or of those that lead there"
            else:
                hint = f"add a transition `... -> {name} when ...`, or remove the phase"
            message = f"nothing leads to `{name}`: `{machine.name}` is never in this phase"
            yield warning("W010", checker.span(phase), message, hint)
        elif not taken[name]:
            message = f"nothing leaves `{name}`: once there, `{machine.name}` stays in this phase"
            hint = "fine for a phase that ends the machine; otherwise add a transition from it"
            yield note("W011", checker.span(phase), message, hint)


def _phases(node: ast.MachineDecl) -> tuple[ast.NameNode, ...]:
    """Return the first mention of each phase, in the order written."""
    phases = {name.text: name for name in (node.initial, *node.tasks)}
    for transition in node.transitions:
        for phase in (transition.source, transition.target):
            if phase is not None:
                phases.setdefault(phase.text, phase)
    return tuple(phases.values())


def _is_target(node: ast.MachineDecl, name: str) -> bool:
    return any(t.target.text == name for t in node.transitions)


def _targets(machine: Machine, phase: float) -> frozenset[float]:
    """Return the other phases that a transition from `phase` may lead to.

    A transition is never taken if its condition is the constant false, or if one above it has the constant
    true.
    """
    found = set[float]()
    for transition in machine.transitions:
        if phase in transition.sources and not _is_constant(transition, False):
            found.add(transition.target)
            if _is_constant(transition, True):
                break
    return frozenset(found - {phase})


def _is_constant(transition: Transition, value: bool) -> bool:
    return constant_value(transition.condition) is value or (not value and _is_false(transition.condition))


def _is_false(condition: ir.Expression) -> bool:
    """Return True if a part of a conjunction is constantly false, as the `until` of a task may be."""
    if isinstance(condition, ir.BinaryOperation) and condition.operator is ir.Binary.AND:
        return _is_false(condition.left) or _is_false(condition.right)
    return constant_value(condition) is False


def _reached(machine: Machine, taken: dict[str, frozenset[float]]) -> frozenset[str]:
    """Return the phases to which transitions lead from the start phase, which is one of them."""
    names = {number: name for name, number in machine.type.members}
    reached, pending = set[str](), [names[machine.start]]
    while pending:
        name = pending.pop()
        if name not in reached:
            reached.add(name)
            pending += [names[number] for number in taken[name]]
    return frozenset(reached)
