"""Checking of derived values: file-level params, lets, states and machines."""

from __future__ import annotations

from collections.abc import Iterable

from colony.dsl import ast
from colony.dsl.check.checker import Checker
from colony.dsl.check.compatibility import without_wildcard
from colony.dsl.check.robot import check_type
from colony.dsl.check.scope import (
    BrokenSymbol,
    LetSymbol,
    MachineSymbol,
    ParamSymbol,
    RobotScope,
    StateSymbol,
    ValueSymbol,
)
from colony.dsl.check.site_values import site_param
from colony.ir import program as ir
from colony.ir.expression import DerivedValue, Expression, SensorValue
from colony.ir.types import BOOL, Enum, Scalar, ScalarValue
from colony.text.units import BASE_UNITS


def check_param(checker: Checker, node: ast.ParamDecl, full_name: str) -> ParamSymbol | BrokenSymbol:
    """Check a named constant; what a site sets for its full name stands in for its value."""
    found = checker.constant(node.value, None, f"param `{node.name.text}`")
    if found is None:
        return BrokenSymbol()
    given = checker.scope.site.get(full_name)
    own = ParamSymbol(type=without_wildcard(found.type), value=found.value)
    return own if given is None else site_param(checker, given, own, node)


def check_let(checker: Checker, node: ast.LetDecl, name: str) -> ir.Let | None:
    """Check a let whose full name is `name`."""
    found = checker.check(node.value)
    return None if found is None else ir.Let(name=name, expression=found, span=checker.span(node.name))


def check_state(checker: Checker, node: ast.StateDecl) -> tuple[Scalar, ScalarValue] | None:
    """Return the type and initial value of a state; without a declared type, it has that of the value."""
    expected_type: Scalar | None = None
    if node.type is not None:
        found = check_type(checker, node.type)
        if found is None:
            return None
        expected_type, _ = found
    what = f"the initial value of `{node.name.text}`"
    if expected_type is not None:
        initial = checker.constant(node.initial, expected_type, what)
    else:
        initial = checker.constant(node.initial, None, what)
    if initial is None:
        return None
    type_ = expected_type if expected_type is not None else without_wildcard(initial.type)
    return type_, initial.value  # type: ignore[return-value]


def check_nexts(
    checker: Checker, nodes: Iterable[ast.NextDecl], states: dict[str, ValueSymbol]
) -> dict[str, Expression]:
    """Return the checked next values, by the names of the states as written."""
    nexts: dict[str, Expression] = {}
    assigned: set[str] = set()
    for node in nodes:
        name = node.name.text
        symbol = states.get(name)
        if symbol is None:
            hint = checker.report.suggest(name, states) or f"declare it: `state {name} = ...`"
            checker.error("E403", node.name, f"there is no state `{name}` here", hint)
            continue
        if name in assigned:
            checker.error("E403", node.name, f"`next {name}` is given twice", "choose with `if`")
            continue
        assigned.add(name)
        if isinstance(symbol, StateSymbol):
            found = checker.expect(node.value, symbol.type, f"the next value of `{name}`")
            if found is not None:
                nexts[name] = found
        else:
            checker.check(node.value)
    return nexts


def machine_type(checker: Checker, node: ast.MachineDecl) -> MachineSymbol | BrokenSymbol:
    """Return the symbol of a machine; its phases are numbered in the order in which they are first named."""
    phases: dict[str, ast.Name] = {node.initial.text: node.initial}
    for transition in node.transitions:
        for phase in (transition.source, transition.target):
            if phase is not None:
                phases.setdefault(phase.text, phase)
    for name, phase in phases.items():
        if name in BASE_UNITS:
            hint = "after a number in a condition it would be read as the unit"
            checker.error("E407", phase, f"a phase cannot be named `{name}`, which is a unit", hint)
        if name == "any":
            hint = "`any -> b` is from every phase but `b`"
            checker.error("E407", phase, "a phase cannot be named `any`, which means all phases", hint)
    full_name = checker.scope.full_name(node.name.text)
    members = tuple((name, float(i)) for i, name in enumerate(phases))
    return MachineSymbol(name=full_name, type=Enum(name=full_name, members=members, kind="machine"))


def check_machine(checker: Checker, node: ast.MachineDecl, type_: Enum) -> ir.Machine | None:
    """Check a machine; `any` means every phase but the target."""
    numbers = dict(type_.members)
    transitions: list[ir.Transition] = []
    for transition in node.transitions:
        condition = checker.expect(transition.condition, BOOL, "the condition of a transition")
        if condition is None:
            continue
        target = numbers[transition.target.text]
        if transition.source is None:
            sources = frozenset(numbers.values()) - {target}
        else:
            sources = frozenset({numbers[transition.source.text]})
        span = checker.span(transition)
        transitions.append(
            ir.Transition(
                sources=sources,
                target=target,
                condition=condition,
                failsafe=transition.failsafe,
                span=span,
            )
        )
    return ir.Machine(
        name=checker.scope.full_name(node.name.text),
        span=checker.span(node.name),
        type=type_,
        start=numbers[node.initial.text],
        transitions=tuple(transitions),
    )


def let_symbol(let: ir.Let, module: str | None = None) -> LetSymbol:
    """Return the symbol of a let."""
    return LetSymbol(name=let.name, type=without_wildcard(let.expression.type), module=module)


def note_sensor_name(robot: RobotScope, let: ir.Let) -> None:
    """Add a let of a file to the names of sensors if it gives a sensor another name."""
    match let.expression:
        case SensorValue(name=name):
            robot.renamed[let.name] = name
        case DerivedValue(name=name) if name in robot.renamed:
            robot.renamed[let.name] = robot.renamed[name]
        case _:
            pass
