"""Inputs of modules: values that a module reads, and that a derived module binds to expressions.

An input that is bound becomes a let of the program with the full name `module.input`: it is computed once a
frame, with one memory, and the module needs it where it reads it. A module with inputs that are not bound is
a template, from which others are derived; it is no module of the program.
"""

from __future__ import annotations

from collections.abc import Mapping

from colony.dsl import ast
from colony.dsl.check.checker import Checker
from colony.dsl.check.compatibility import as_declared, with_article
from colony.dsl.check.expressions import ExpressionChecker
from colony.dsl.check.robot import argument_hint, check_parameter, takes, what_it_takes
from colony.dsl.check.scope import BrokenSymbol, LetSymbol, Report, Scope, TypedParameter, ValueSymbol
from colony.ir import program as ir
from colony.ir.expression import DerivedValue
from colony.record import Record, record


@record
class Binding(Record):
    """An expression that an input is bound to, the scope in which it is read, and the name to point at."""

    name: ast.Name
    value: ast.Expression
    scope: Scope


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
    report: Report,
    module: str,
    clauses: list[ast.InputDecl],
    bindings: Mapping[str, Binding],
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
            binding = Binding(name=clause.name, value=clause.initial, scope=checker.scope)
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


def _bound(report: Report, full_name: str, typed: TypedParameter, binding: Binding) -> ir.Let | None:
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
