"""The names of params that a site may set: those of the program, but not those of the robot's interface.

The description of a robot sets its own params: those of its file and of all that it imports. In a file that
declares a robot beside a behavior, they are the params that the robot's declaration reads.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import fields

from colony.dsl import ast
from colony.dsl.check.declare import MODULE_DECLARATIONS
from colony.dsl.check.scope import ModuleSymbol, Report, Scope, is_private, span_of
from colony.dsl.site import SiteParams, SiteValue
from colony.ir.site import Site
from colony.record import Record, record
from colony.text.diagnostics import Label, error
from colony.text.suggestions import did_you_mean

_MAX_LISTED = 8

ModuleNode = ast.ModuleDecl | ast.DerivedModuleDecl | ast.PythonModuleDecl


@record
class _Declared(Record):
    """A name that the program declares, and its declaration.

    Attributes:
        kind: what it is, for messages; "a param" for a param of the program.
        scope: the names of its file.
        node: the name in its declaration.
    """

    kind: str
    scope: Scope
    node: ast.Name


_PARAM = "a param"
_OF_ROBOT = "a param of the robot's interface, which its description sets"
_PRIVATE = "a name that belongs to its file"


def bind_params(report: Report, scopes: list[Scope], params: SiteParams) -> Site:
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

    def __init__(self, scopes: list[Scope]) -> None:
        self._root = scopes[-1]
        self._scopes = scopes
        self._of_robot = _interface_files(scopes)
        self._modules: dict[str, tuple[Scope, ModuleNode]] = {}
        self.is_incomplete = any(scope.incomplete or scope.file.lost_names for scope in scopes)
        self.names: dict[str, _Declared] = {}
        for scope in scopes:
            for node in scope.file.tree.declarations:
                if isinstance(node, MODULE_DECLARATIONS):
                    self._modules.setdefault(scope.full_name(node.name.text), (scope, node))
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

    def _add_declaration(self, scope: Scope, node: ast.Declaration) -> None:
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
                    assert isinstance(node, ast.Named)
                    self._add(scope, scope.full_name(node.name.text), node.name, kind)

    def _add_members(self, scope: Scope, module: str, node: ModuleNode) -> None:
        home, text = self._text_of(scope, node)
        for clause in () if text is None else text.clauses:
            kind = _PARAM if isinstance(clause, ast.ParamDecl) else _KINDS.get(type(clause))
            if kind is not None:
                assert isinstance(clause, ast.Named)
                own = home if node is text else scope
                self._add(
                    own, f"{module}.{clause.name.text}", clause.name if node is text else node.name, kind
                )

    def _text_of(
        self, scope: Scope, node: ModuleNode
    ) -> tuple[Scope, ast.ModuleDecl | ast.PythonModuleDecl | None]:
        """Return the declaration that a module, which may be derived, has its text from."""
        seen: set[str] = set()
        while isinstance(node, ast.DerivedModuleDecl):
            inner, path = scope.resolve(node.base.path)
            symbol = inner.network_symbol(path[0]) if len(path) == 1 else None
            if (
                not isinstance(symbol, ModuleSymbol)
                or symbol.name in seen
                or symbol.name not in self._modules
            ):
                return scope, None  # reported where modules are checked
            seen.add(symbol.name)
            scope, node = self._modules[symbol.name]
        return scope, node

    def _add(self, scope: Scope, full_name: str, node: ast.Name, kind: str) -> None:
        if any(map(is_private, re.split("[.:]", full_name))):  # `low:_p` is one of two files with a `_p`
            kind = _PRIVATE
        elif kind == _PARAM and scope.file.key in self._of_robot:
            kind = _OF_ROBOT
        self.names.setdefault(full_name, _Declared(kind=kind, scope=scope, node=node))

    def _read_by_robot(self) -> set[str]:
        """Return the full names of the params that robots read, also by way of other params."""
        found: set[str] = set()
        work: list[tuple[Scope, ast.SyntaxNode]] = [
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
            for reference in _references(node):
                inner, path = scope.resolve(reference.path)
                owner = inner.visible_values.get(path[0])
                full_name = "" if owner is None else owner.full_name(path[0])
                if full_name in params and full_name not in found:
                    found.add(full_name)
                    work.append(params[full_name])
        return found


_KINDS: Mapping[type, str] = {
    ast.LetDecl: "a let",
    ast.StateDecl: "a state",
    ast.MachineDecl: "a machine",
    ast.EnumDecl: "an enum",
    ast.FunctionDecl: "a function",
    ast.InputDecl: "an input",
    ast.ContractDecl: "a contract",
}


def _interface_files(scopes: list[Scope]) -> set[str]:
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


def _references(node: ast.SyntaxNode) -> Iterator[ast.Reference]:
    """Yield all references in a declaration."""
    work: list[object] = [node]
    while work:
        part = work.pop()
        if isinstance(part, ast.Reference):
            yield part
        elif isinstance(part, tuple):
            work += part
        elif isinstance(part, Record):
            work += [getattr(part, f.name) for f in fields(part)]  # type: ignore[arg-type]
