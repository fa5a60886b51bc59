"""Values of params that a site sets, checked where they stand in for those in the text.

Such a value may read what the value in its place may read: enums, and the params above it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from colony.dsl import ast
from colony.dsl.check.checker import Checker, short_number
from colony.dsl.check.compatibility import fits, with_article
from colony.dsl.check.declare import ModuleNode, modules_declared, references_in, text_of
from colony.dsl.check.scope import (
    BrokenSymbol,
    CheckReport,
    FileScope,
    ParamSymbol,
    TunableSymbol,
    is_private,
    span_of,
)
from colony.dsl.parse import parse
from colony.dsl.site import SiteParams, SiteValue
from colony.ir.site import Site
from colony.ir.types import DIMENSIONLESS, Enum, Quantity, Value, is_percent, type_text
from colony.record import Record, record
from colony.text.diagnostics import Diagnostic, Label, error, has_errors
from colony.text.source import Source
from colony.text.wording import did_you_mean

# --- site names ----------------------------------------------------------------------------------------
#
# The names of params that a site may set: those of the program, but not those of the robot's interface.
#
# The description of a robot sets its own params: those of its file and of all that it imports. In a file
# that declares a robot beside a behavior, they are the params that the robot's declaration reads.


_MAX_LISTED = 8


@record
class _Declared(Record):
    """A name that the program declares, and its declaration.

    Attributes:
        kind: what it is, for messages; "a param" for a param of the program.
        scope: the names of its file.
        node: the name in its declaration.
    """

    kind: str
    scope: FileScope
    node: ast.NameNode


_PARAM = "a param"
_OF_ROBOT = "a param of the robot's interface, which its description sets"
_PRIVATE = "a name that belongs to its file"


def bind_params(report: CheckReport, scopes: list[FileScope], params: SiteParams) -> Site:
    """Give the scopes of a program the values that a site sets; report names that no site may set."""
    catalog = _Catalog(scopes)
    bound: dict[str, SiteValue] = {}
    for value in params.values:
        name = catalog.full_name(value.name)
        found = catalog.names.get(name)
        if found is None:
            if not catalog.is_incomplete:
                message = f"the program has no param `{value.name}`"
                hint = _suggestion(value.name, catalog.params())
                report.diagnostics.append(error("E703", value.key, message, hint))
        elif found.kind != _PARAM:
            place = Label(span_of(found.scope, found.node), "it is declared here")
            message = f"`{value.name}` is {found.kind}, not a param of the program"
            hint = _suggestion(value.name, catalog.params(), is_declared=True)
            if found.kind == _OF_ROBOT:
                message = f"`{value.name}` is {_OF_ROBOT}"
                if not hint.startswith("did you mean"):
                    hint = "set it there, or choose another description with --robot"
            report.diagnostics.append(error("E703", value.key, message, hint, place))
        elif name in bound:
            first = Label(bound[name].key, "first set here")
            report.diagnostics.append(
                error("E703", value.key, f"`{value.name}` is set twice", "leave one of them out", first)
            )
        else:
            bound[name] = value
    for scope in scopes:
        scope.site = bound
    values = sorted((name, value.text or "") for name, value in bound.items())
    return Site(file=params.file, values=tuple(values))


def _suggestion(name: str, params: list[str], *, is_declared: bool = False) -> str:
    by_last: dict[str, list[str]] = {}
    for param in params:
        by_last.setdefault(param.rpartition(".")[2], []).append(param)
    same = by_last.get(name.rpartition(".")[2], [])[:_MAX_LISTED]
    if same:
        return f"did you mean {' or '.join(f'`{param}`' for param in same)}?"
    if not params:
        return "it has no params"
    more = f" and {len(params) - _MAX_LISTED} more" if len(params) > _MAX_LISTED else ""
    similar = None if is_declared else did_you_mean(name, params)
    return similar or f"its params are {', '.join(params[:_MAX_LISTED])}{more}"


class _Catalog:
    """The names of a program, each with the kind of its declaration."""

    def __init__(self, scopes: list[FileScope]) -> None:
        self._root = scopes[-1]
        self._scopes = scopes
        self._of_robot = _interface_files(scopes)
        self._modules = modules_declared(scopes)
        self.is_incomplete = any(scope.incomplete or scope.file.lost_names for scope in scopes)
        self.names: dict[str, _Declared] = {}
        for scope in scopes:
            for node in scope.file.tree.declarations:
                self._add_declaration(scope, node)
        for name in self._read_by_robot():
            if name in self.names:
                found = self.names[name]
                self.names[name] = _Declared(kind=_OF_ROBOT, scope=found.scope, node=found.node)

    def params(self) -> list[str]:
        """Return the full names of all params that a site may set."""
        return [name for name, found in self.names.items() if found.kind == _PARAM]

    def full_name(self, written: str) -> str:
        """Return the full name of a name that the main file may write with aliases."""
        if written in self.names:
            return written
        scope, (first, *rest) = self._root.resolve(tuple(written.split(".")))
        owner = scope.visible_values.get(first) or scope.visible_network_symbols.get(first)
        return written if owner is None else ".".join((owner.full_name(first), *rest))

    def _add_declaration(self, scope: FileScope, node: ast.Declaration) -> None:
        match node:
            case ast.ParamDecl():
                self._add(scope, scope.full_name(node.name.text), node.name, _PARAM)
            case ast.RobotDecl(items=items):
                for item in items:
                    if isinstance(item, ast.SensorDecl | ast.ActuatorDecl):
                        noun = "a sensor" if isinstance(item, ast.SensorDecl) else "an actuator"
                        self._add(scope, item.name.text, item.name, noun)
            case ast.ModuleDecl() | ast.PythonModuleDecl() | ast.DerivedModuleDecl():
                full_name = scope.full_name(node.name.text)
                self._add(scope, full_name, node.name, "a module")
                self._add_members(scope, full_name, node)
            case _:
                kind = _KINDS.get(type(node))
                if kind is not None:
                    assert isinstance(node, ast.NamedNode)
                    self._add(scope, scope.full_name(node.name.text), node.name, kind)

    def _add_members(self, scope: FileScope, module: str, node: ModuleNode) -> None:
        home, text, _ = text_of(scope, node, self._modules)
        for clause in () if text is None else text.clauses:
            kind = _PARAM if isinstance(clause, ast.ParamDecl) else _KINDS.get(type(clause))
            if kind is not None:
                assert isinstance(clause, ast.NamedNode)
                own = home if node is text else scope
                self._add(
                    own, f"{module}.{clause.name.text}", clause.name if node is text else node.name, kind
                )

    def _add(self, scope: FileScope, full_name: str, node: ast.NameNode, kind: str) -> None:
        if any(map(is_private, re.split("[.:]", full_name))):  # `low:_p` is one of two files with a `_p`
            kind = _PRIVATE
        elif kind == _PARAM and scope.file.key in self._of_robot:
            kind = _OF_ROBOT
        self.names.setdefault(full_name, _Declared(kind=kind, scope=scope, node=node))

    def _read_by_robot(self) -> set[str]:
        """Return the full names of the params that robots read, also by way of other params."""
        found: set[str] = set()
        work: list[tuple[FileScope, ast.SyntaxNode]] = [
            (scope, node)
            for scope in self._scopes
            for node in scope.file.tree.declarations
            if isinstance(node, ast.RobotDecl)
        ]
        params = {
            scope.full_name(node.name.text): (scope, node)
            for scope in self._scopes
            for node in scope.file.tree.declarations
            if isinstance(node, ast.ParamDecl)
        }
        while work:
            scope, node = work.pop()
            for reference in references_in(node):
                inner, path = scope.resolve(reference.path)
                owner = inner.visible_values.get(path[0])
                full_name = "" if owner is None else owner.full_name(path[0])
                if full_name in params and full_name not in found:
                    found.add(full_name)
                    work.append(params[full_name])
        return found


_KINDS: Mapping[type, str] = {
    ast.SensorDecl: "an input",
    ast.LetDecl: "a let",
    ast.StateDecl: "a state",
    ast.MachineDecl: "a machine",
    ast.SequenceDecl: "a sequence",
    ast.EnumDecl: "an enum",
    ast.FunctionDecl: "a function",
    ast.InputDecl: "an input",
    ast.ContractDecl: "a contract",
    ast.AssumeDecl: "an assumption",
}


def _interface_files(scopes: list[FileScope]) -> set[str]:
    """Return the keys of the files of a robot's description, if it is not the main file."""
    by_key = {scope.file.key: scope for scope in scopes}
    work = [
        scope.file.key
        for scope in scopes[:-1]
        if any(isinstance(node, ast.RobotDecl) for node in scope.file.tree.declarations)
    ]
    found: set[str] = set()
    while work:
        key = work.pop()
        if key in by_key and key not in found:
            found.add(key)
            work += [import_.target for import_ in by_key[key].file.imports]
    return found - {scopes[-1].file.key}


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
    report = CheckReport()
    scope = replace(checker.scope, file=replace(checker.scope.file, source=source))
    found = replace(checker, scope=scope, report=report).constant(value, None, f"`{given.name}`")
    if found is None or has_errors(report.diagnostics):
        problem = report.diagnostics[0]
        return refuse(_about(given, problem), problem.hint)
    if not fits(found.type, own.type):
        message = f"`{given.name}` is {with_article(own.type)}, found {with_article(found.type)}"
        return refuse(message, _unit_hint(value, own, node))
    if isinstance(own, TunableSymbol) and (outside := outside_text(own, found.value)) is not None:
        return refuse(f"`{given.name}` is {outside}", None)
    return ParamSymbol(type=own.type, value=found.value)


def outside_text(symbol: TunableSymbol, value: Value) -> str | None:
    """Return a text if a value is outside of the interval of a tunable param; None if it is inside."""
    sensor = symbol.sensor
    assert sensor.low is not None
    assert sensor.high is not None
    if sensor.low <= value <= sensor.high:  # type: ignore[operator]
        return None
    low, high = (f"{bound / sensor.factor:.9g} {sensor.unit}".rstrip() for bound in (sensor.low, sensor.high))
    return f"outside of its interval, {low} .. {high}"


def declared_unit(node: ast.SyntaxNode) -> str | None:
    """Return the unit of a param that is declared as one number."""
    declared = _unsigned(node.value) if isinstance(node, ast.ParamDecl) else None
    return declared.unit if isinstance(declared, ast.NumberNode) else None


def _unsigned(node: ast.Expression) -> ast.Expression:
    while isinstance(node, ast.Prefix) and node.operator == "-":
        node = node.operand
    return node


def _about(given: SiteValue, problem: Diagnostic) -> str:
    name = f"`{given.name}`"
    return problem.message if problem.message.startswith(name) else f"{name}: {problem.message}"


def _unit_hint(value: ast.Expression, own: ParamSymbol, node: ast.SyntaxNode) -> str | None:
    """Return advice on the unit of a lone number, which is that of the declaration."""
    number, unit = _unsigned(value), declared_unit(node)
    if not (isinstance(number, ast.NumberNode) and isinstance(own.type, Quantity)):
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
