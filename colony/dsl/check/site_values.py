"""Values of params that a site sets, checked where they stand in for those in the text.

Such a value may read what the value in its place may read: enums, and the params above it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from colony.dsl import ast
from colony.dsl.check.checker import Checker, short_number
from colony.dsl.check.compatibility import fits, with_article
from colony.dsl.check.scope import BrokenSymbol, ParamSymbol, Report
from colony.dsl.parse import parse
from colony.dsl.site import SiteParams, SiteValue
from colony.ir.types import DIMENSIONLESS, Enum, Quantity, is_percent, type_text
from colony.text.diagnostics import Diagnostic, Label, error, has_errors
from colony.text.source import Source

# --- site labels --------------------------------------------------------------------------------------
#
# Labels on the errors that a program has only because of the values that a site sets.

MAX_LABELS = 5
"""Maximum number of values that one error refers to."""


def with_site_labels(
    found: Sequence[Diagnostic], own: Sequence[Diagnostic], params: SiteParams
) -> tuple[Diagnostic, ...]:
    """Return findings with labels at the values behind those errors that the program has only with `params`.

    Args:
        found: the findings with the values of the site.
        own: the findings without them.
        params: the values.
    """
    before = {_identity(d) for d in own}
    return tuple(
        d
        if d.severity != "error" or _identity(d) in before or _is_about_site(d, params)
        else replace(d, labels=(*d.labels, *_labels(d, params)))
        for d in found
    )


def _identity(d: Diagnostic) -> tuple[object, ...]:
    return d.code, d.span.source.name, d.span.start, d.message


def _is_about_site(d: Diagnostic, params: SiteParams) -> bool:
    return any(d.span.source is value.key.source for value in params.values)


def _labels(d: Diagnostic, params: SiteParams) -> list[Label]:
    """Return labels at the values that the text of an error names, or at all if it names none."""
    words = set(re.findall(r"\w+", d.span.text))
    usable = [value for value in params.values if value.text is not None]
    named = [value for value in usable if value.name.rpartition(".")[2] in words]
    return [
        Label(value.place, f"the value of `{value.name}`, which stands in for the one in the program")
        for value in (named or usable)[:MAX_LABELS]
    ]


# --- site values --------------------------------------------------------------------------------------

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
    return ParamSymbol(type=own.type, value=found.value)


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
    if unit is None and own.type == DIMENSIONLESS and not is_percent(own.type):
        return "give it without a unit"
    if number.unit is not None:
        return f"give it in {unit or type_text(own.type)}"
    sign = "-" if isinstance(value, ast.Prefix) else ""
    shown = f"{sign}{short_number(number.digits)}"
    if unit == "percent" and float(number.digits) <= 1:
        return f'write its unit: {shown} is "{sign}{float(number.digits) * 100:.15g} percent"'
    return f'write its unit, for example "{shown} {unit or type_text(own.type)}"'
