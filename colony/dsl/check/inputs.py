"""Inputs of modules: values that a module reads, and that a derived module binds to expressions.

An input that is bound becomes a let of the program with the full name `module.input`: it is computed once a
frame, with one memory, and the module needs it where it reads it. A module with inputs that are not bound is
a template, from which others are derived; it is no module of the program.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from colony.dsl import ast
from colony.dsl.check.checker import Checker
from colony.dsl.check.compatibility import as_declared, unit_of, with_article, without_wildcard
from colony.dsl.check.expressions import ExpressionChecker
from colony.dsl.check.robot import (
    RESERVED_SENSORS,
    argument_hint,
    check_parameter,
    check_type,
    reject_reserved,
    takes,
    what_it_takes,
)
from colony.dsl.check.scope import (
    BrokenSymbol,
    CheckReport,
    FileScope,
    LetSymbol,
    MachineSymbol,
    ParamSymbol,
    RobotScope,
    StateSymbol,
    TunableSymbol,
    TypedParameter,
    ValueSymbol,
)
from colony.dsl.check.site_values import declared_unit, outside_text, site_param
from colony.ir import program as ir
from colony.ir.expression import Binary, BinaryOperation, DerivedValue, Expression, SensorValue
from colony.ir.types import BOOL, DIMENSIONLESS, Enum, Quantity, Scalar, ScalarValue, Value, unit_shown
from colony.record import Record, record
from colony.text.units import BASE_UNITS

# --- derived -------------------------------------------------------------------------------------------
#
# Checking of derived values: file-level params, lets, states and machines.


def check_param(checker: Checker, node: ast.ParamDecl, full_name: str) -> ParamSymbol | BrokenSymbol:
    """Check a param; what a site sets for its full name stands in for its value."""
    found = checker.constant(node.value, None, f"param `{node.name.text}`")
    if found is None:
        return BrokenSymbol()
    given = checker.scope.site.get(full_name)
    own = ParamSymbol(type=without_wildcard(found.type), value=found.value)
    if node.interval is None:
        return own if given is None else site_param(checker, given, own, node)
    tunable = _tunable(checker, node, node.interval, full_name, own)
    if tunable is None:
        return BrokenSymbol()
    if full_name == node.name.text:
        reject_reserved(checker, node.name, RESERVED_SENSORS, "tunable param")
    symbol = tunable if given is None else site_param(checker, given, tunable, node)
    return with_value(tunable, symbol.value) if isinstance(symbol, ParamSymbol) else symbol


def _tunable(
    checker: Checker, node: ast.ParamDecl, interval: ast.RangeNode, full_name: str, own: ParamSymbol
) -> TunableSymbol | None:
    """Return a param that may change within its interval while the program runs."""
    if not isinstance(own.type, Quantity):
        message = f"a tunable param is a number; this is {with_article(own.type)}"
        checker.error("E303", node.value, message, "leave `tunable` out, or read a variable of DServer")
        return None
    unit = declared_unit(node)
    if unit is None:
        unit = "" if own.type == DIMENSIONLESS else unit_shown(own.type).text
    low = checker.constant_in(interval.low, own.type, unit, "the lower bound of an interval")
    high = checker.constant_in(interval.high, own.type, unit, "the upper bound of an interval")
    if low is None or high is None:
        return None
    if low > high:
        message = "the interval is empty: its lower bound is above its upper bound"
        checker.error("E303", interval, message, "swap the bounds")
        return None
    sensor = ir.Sensor(
        name=full_name,
        span=checker.span(node.name),
        type=own.type,
        unit=unit,
        factor=float(unit_of(unit).factor) if unit else 1.0,
        low=float(low),
        high=float(high),
        default=float(own.value),  # type: ignore[arg-type]
        server=ir.TUNABLE_SERVER,
        field=full_name,
        tunable=True,
    )
    symbol = TunableSymbol(type=own.type, value=own.value, sensor=sensor)
    outside = outside_text(symbol, own.value)
    if outside is not None:
        checker.error("E304", node.value, f"`{node.name.text}` is {outside}")
        return None
    return symbol


def with_value(symbol: TunableSymbol, value: Value, name: str | None = None) -> TunableSymbol:
    """Return a tunable param with another value, and with another full name if one is given."""
    full_name = name or symbol.sensor.name
    sensor = replace(symbol.sensor, name=full_name, field=full_name, default=float(value))  # type: ignore[arg-type]
    return TunableSymbol(type=symbol.type, value=value, sensor=sensor)


def check_let(checker: Checker, node: ast.LetDecl, name: str) -> ir.Let | None:
    """Check a let whose full name is `name`."""
    found = checker.check(node.value)
    return None if found is None else ir.Let(name=name, expression=found, span=checker.span(node.name))


def check_assumption(checker: Checker, node: ast.AssumeDecl) -> ir.Let | None:
    """Check an assumption as the let that it is: a bool, missing where something that it reads is missing."""
    found = checker.expect(node.expression, BOOL, "an assumption")
    if found is None:
        return None
    return ir.Let(
        name=checker.scope.full_name(node.name.text), expression=found, span=checker.span(node.name)
    )


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
    phases: dict[str, ast.NameNode] = {node.initial.text: node.initial}
    for task in node.tasks:
        phases.setdefault(task.text, task)
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
        what = "the condition of a transition" if transition.through is None else "`until`"
        condition = checker.expect(transition.condition, BOOL, what)
        if transition.through is not None and condition is not None:
            condition = both(condition, checker.check(transition.through))
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
        tasks=tuple(task.text for task in node.tasks),
    )


def both(left: Expression, right: Expression | None) -> Expression | None:
    """Return `left and right`, which stands at `left`; None without `right`."""
    if right is None:
        return None
    return BinaryOperation(type=BOOL, operator=Binary.AND, left=left, right=right, span=left.span)


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


# --- inputs --------------------------------------------------------------------------------------------


@record
class InputBinding(Record):
    """An expression that an input is bound to, the scope in which it is read, and the name to point at."""

    name: ast.NameNode
    value: ast.Expression
    scope: FileScope


@record
class Inputs(Record):
    """The inputs of a module, checked.

    Attributes:
        lets: those that are bound, in order, by their full names.
        unbound: the names, as written, of those that are not bound.
        are_valid: False if an error in one was reported.
    """

    lets: tuple[ir.Let, ...]
    unbound: tuple[str, ...]
    are_valid: bool


def check_inputs(
    checker: Checker,
    report: CheckReport,
    module: str,
    clauses: list[ast.InputDecl],
    bindings: Mapping[str, InputBinding],
) -> Inputs:
    """Check the inputs of a module and what they are bound to, and add their symbols to the module's names.

    Args:
        checker: the checker of the module's text.
        report: the collector of findings in bindings.
        module: the full name of the module.
        clauses: the declarations of the inputs.
        bindings: what derived modules bind, by the names of the inputs.
    """
    lets: list[ir.Let] = []
    unbound: list[str] = []
    local: dict[str, ValueSymbol] = {}
    for clause in clauses:
        name, typed = clause.name.text, check_parameter(checker, clause)
        binding = bindings.get(name)
        if binding is None and clause.initial is not None:
            binding = InputBinding(name=clause.name, value=clause.initial, scope=checker.scope)
        if binding is None:
            unbound.append(name)  # an array has bearings only where it is bound, and is checked there
            local[name] = BrokenSymbol()
            if typed is not None and not typed.is_array:
                local[name] = LetSymbol(name=f"{module}.{name}", type=typed.element)
            continue
        let = None if typed is None else _bound(report, f"{module}.{name}", typed, binding)
        local[name] = BrokenSymbol() if let is None else LetSymbol(name=let.name, type=let.expression.type)
        lets += [let] if let else []
    assert isinstance(checker.local, dict)
    checker.local.update(local)
    is_whole = len(lets) + len(unbound) == len(clauses)
    return Inputs(lets=tuple(lets), unbound=tuple(unbound), are_valid=is_whole)


def _bound(
    report: CheckReport, full_name: str, typed: TypedParameter, binding: InputBinding
) -> ir.Let | None:
    """Return the let that a bound input is, or None after reporting an error."""
    checker = ExpressionChecker(scope=binding.scope, report=report)
    found = checker.check(binding.value)
    if found is None:
        return None
    if not takes(typed, found.type):
        what = f"input `{typed.name}` takes {what_it_takes(typed)}"
        hint = argument_hint(binding.value, typed, found.type)
        checker.error("E404", binding.value, f"{what}, found {with_article(found.type)}", hint)
        return None
    return ir.Let(
        name=full_name, expression=as_declared(found, typed.element), span=checker.span(binding.name)
    )


def input_readings(
    checker: Checker, clauses: list[ast.InputDecl], reads: list[ast.Reference]
) -> list[ir.PythonReading]:
    """Return what a module in Python reads of its inputs, under their names as written."""
    readings: list[ir.PythonReading] = []
    names = {node.text: node for node in reads}
    for clause in clauses:
        name, symbol = clause.name.text, checker.local[clause.name.text]
        if name in names:
            message = f"`{name}` is an input, and the module reads another `{name}`"
            checker.error("E102", clause.name, message, "rename the input", checker.label(names[name]))
        if isinstance(symbol, LetSymbol):
            value = DerivedValue(type=symbol.type, name=symbol.name, span=checker.span(clause.name))
            readings.append(ir.PythonReading(name=name, expression=value))
    return readings
