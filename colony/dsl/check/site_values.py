"""Values of params that a site sets, checked where they stand in for those in the text.

Such a value may read what the value in its place may read: enums, and the params above it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from colony.dsl import ast
from colony.dsl.check.checker import Checker, short_number
from colony.dsl.check.compatibility import fits, with_article
from colony.dsl.check.percent import PERCENT
from colony.dsl.check.scope import BrokenSymbol, ParamSymbol, Report
from colony.dsl.parse import parse
from colony.dsl.site import SiteValue
from colony.ir.types import DIMENSIONLESS, Enum, Quantity, type_text
from colony.text.diagnostics import Diagnostic, Label, error, has_errors
from colony.text.source import Source

_PREFIX = "param value = "


def site_param(
    checker: Checker, given: SiteValue, own: ParamSymbol, node: ast.SyntaxNode
) -> ParamSymbol | BrokenSymbol:
    """Return a param with the value that a site sets, or report that it cannot have it.

    Args:
        checker: the checker of the text that the value stands in for.
        given: the value of the site.
        own: the param with its own value, whose type it keeps.
        node: the declaration of the param, or the derived module that has it.
    """
    if given.text is None:
        return BrokenSymbol()
    if isinstance(own.type, Enum):
        number = dict(own.type.members).get(given.text)
        if number is not None:
            return ParamSymbol(type=own.type, value=number)

    def refuse(message: str, hint: str | None) -> BrokenSymbol:
        label = Label(checker.span(node), "the param is declared here")
        checker.report.diagnostics.append(error("E704", given.place, message, hint, label))
        return BrokenSymbol()

    source = Source(given.place.source.name, _PREFIX + given.text)
    parsed = parse(source)
    if parsed.diagnostics:
        first = parsed.diagnostics[0]
        return refuse(f"`{given.name}` is not a value of the language: {first.message}", first.hint)
    match parsed.file.declarations:
        case (ast.ParamDecl(value=value),) if parsed.file.language is None:
            pass
        case _:
            return refuse(f"`{given.name}` is more than a value", 'write one value, such as "250 mm/s"')
    report = Report()
    scope = replace(checker.scope, file=replace(checker.scope.file, source=source))
    found = replace(checker, scope=scope, report=report).constant(value, None, f"`{given.name}`")
    if found is None or has_errors(report.diagnostics):
        problem = report.diagnostics[0]
        return refuse(_about(given, problem), problem.hint)
    if not fits(found.type, own.type):
        message = f"`{given.name}` is {with_article(own.type)}, found {with_article(found.type)}"
        return refuse(message, _unit_hint(value, own, node))
    if _lacks_unit(value, node):
        return refuse(
            f"`{given.name}` is declared with a unit, found a plain number", _unit_hint(value, own, node)
        )
    return ParamSymbol(type=own.type, value=found.value)


def _lacks_unit(value: ast.Expression, node: ast.SyntaxNode) -> bool:
    """Return True for a plain number in the place of one in percent, which has a unit and no dimension."""
    number = _unsigned(value)
    is_plain = isinstance(number, ast.Number) and number.unit is None and float(number.digits) != 0
    return is_plain and _declared_unit(node) is not None


def _declared_unit(node: ast.SyntaxNode) -> str | None:
    """Return the unit of a param that is declared as one number."""
    declared = _unsigned(node.value) if isinstance(node, ast.ParamDecl) else None
    return declared.unit if isinstance(declared, ast.Number) else None


def _unsigned(node: ast.Expression) -> ast.Expression:
    while isinstance(node, ast.Prefix) and node.operator == "-":
        node = node.operand
    return node


def _about(given: SiteValue, problem: Diagnostic) -> str:
    name = f"`{given.name}`"
    return problem.message if problem.message.startswith(name) else f"{name}: {problem.message}"


def _unit_hint(value: ast.Expression, own: ParamSymbol, node: ast.SyntaxNode) -> str | None:
    """Return advice on the unit of a lone number, which is that of the declaration."""
    number, unit = _unsigned(value), _declared_unit(node)
    if not (isinstance(number, ast.Number) and isinstance(own.type, Quantity)):
        return None
    if unit is None and own.type.dimension == DIMENSIONLESS.dimension:
        return "give it without a unit"
    if number.unit is not None:
        return f"give it in {unit or type_text(own.type)}"
    sign = "-" if isinstance(value, ast.Prefix) else ""
    shown = f"{sign}{short_number(number.digits)}"
    if unit == PERCENT and float(number.digits) <= 1:
        return f'write its unit: {shown} is "{sign}{float(number.digits) * 100:.15g} percent"'
    return f'write its unit, for example "{shown} {unit or type_text(own.type)}"'


def site_numbers(site: Mapping[str, SiteValue]) -> frozenset[tuple[str, float]]:
    """Return the params that a site sets to plain numbers, each by its last name with the number."""
    return frozenset(_numbers(site.items()))


def _numbers(values: Iterable[tuple[str, SiteValue]]) -> Iterable[tuple[str, float]]:
    for name, value in values:
        try:
            yield name.rpartition(".")[2], float(value.text or "")
        except ValueError:
            continue
