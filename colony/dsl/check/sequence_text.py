"""Sequences as the text of the language that they stand for, for people and for tests.

Each `deliver.lift`, which no text can declare, is called `deliver_lift`. The modules of tasks are written in
full, since no derived module has another predicate than its base.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

from colony.dsl import ast
from colony.dsl.check.declare import ModuleNode, modules_declared, text_of
from colony.dsl.check.scope import FileScope, is_private
from colony.record import Record

_Node = TypeVar("_Node")


def written_out(scopes: list[FileScope]) -> tuple[ast.File, tuple[ast.Declaration, ...]]:
    """Return the main file without sequences, and the declarations in it that they stand for.

    Args:
        scopes: all files of a program that has no errors, with what sequences stand for among their
            declarations; the main file is the last.
    """
    root = scopes[-1]
    writer = _Writer(root, modules_declared(scopes))
    own: list[ast.Declaration] = []
    new: list[ast.Declaration] = []
    for node in root.file.tree.declarations:
        if isinstance(node, ast.SequenceDecl):
            continue
        written = list(writer.declaration(node))
        (new if writer.is_new(node) else own).extend(written)
    return replace(root.file.tree, declarations=(*own, *new)), tuple(new)


class _Writer:
    """Writes out the sequences of the main file."""

    def __init__(self, root: FileScope, modules: Mapping[str, tuple[FileScope, ModuleNode]]) -> None:
        self.root = root
        self.modules = modules
        declarations = root.file.tree.declarations
        self.sequences = {d.name.text: d for d in declarations if isinstance(d, ast.SequenceDecl)}
        self.names = dict[str, str]()
        taken = {*root.visible_values, *root.visible_network_symbols, *root.robot.sensor_names}
        taken |= {*root.aliases, *root.robot.actuator_names}
        for node in declarations:
            for name in _dotted(node):
                written = name.replace(".", "_")
                while written in taken:
                    written += "_"
                self.names.setdefault(name, written)
        self.taken = taken | {*self.names.values()}

    def is_new(self, node: ast.Declaration) -> bool:
        """Return True for a declaration that a sequence stands for."""
        if isinstance(node, ast.MachineDecl):
            return node.name.text in self.sequences
        return any(_dotted(node))

    def declaration(self, node: ast.Declaration) -> Iterator[ast.Declaration]:
        """Yield what stands for a declaration in the text."""
        if isinstance(node, ast.DerivedModuleDecl) and node.phase is not None:
            yield from self._task(node, node.phase)
        elif not (isinstance(node, ast.NetworkDecl) and not node.wires):
            yield self._renamed(node)

    def _task(self, node: ast.DerivedModuleDecl, phase: ast.Expression) -> Iterator[ast.Declaration]:
        """Yield the module of a task; one with inputs is derived from a template with its predicate."""
        home, text, _ = text_of(self.root, node, self.modules)
        assert isinstance(text, ast.ModuleDecl)
        params, inputs = self._arguments(node)
        text = _Qualifier(home, self.root, text).module()
        clauses = tuple(
            replace(clause, value=params[clause.name.text])
            if isinstance(clause, ast.ParamDecl) and clause.name.text in params
            else clause
            for clause in text.clauses
        )
        when = phase
        if text.when != ast.Boolean(value=True, start=0, end=0):
            when = ast.Infix(operator="and", left=phase, right=text.when, start=0, end=0)
        name = self._renamed(node.name)
        module = replace(text, name=name, clauses=clauses, when=when, failsafe=False)
        bound = tuple(
            ast.Argument(name=clause.name, value=inputs[clause.name.text], start=0, end=0)
            for clause in clauses
            if isinstance(clause, ast.InputDecl) and clause.name.text in inputs
        )
        if not bound:
            yield self._renamed(module)
            return
        template = f"{name.text}_task"
        while template in self.taken:
            template += "_"
        yield self._renamed(replace(module, name=replace(name, text=template)))
        base = ast.Reference(path=(template,), start=0, end=0)
        yield ast.DerivedModuleDecl(
            name=name, failsafe=False, base=base, arguments=self._renamed(bound), phase=None, start=0, end=0
        )

    def _arguments(
        self, node: ast.DerivedModuleDecl
    ) -> tuple[dict[str, ast.Expression], dict[str, ast.Expression]]:
        """Return the params and inputs that the module of a task is given, on the way to its text."""
        given = dict[str, ast.Expression]()
        scope, current = self.root, node
        while True:
            for argument in current.arguments:
                value = _Qualifier(scope, self.root).expression(argument.value)
                given.setdefault(argument.name.text, value)
            inner, path = scope.resolve_part(current.base.path)
            symbol = inner.network_symbol(path[0])
            scope, base = self.modules[getattr(symbol, "name", "")]
            if not isinstance(base, ast.DerivedModuleDecl):
                params = {c.name.text for c in base.clauses if isinstance(c, ast.ParamDecl)}
                return (
                    {name: value for name, value in given.items() if name in params},
                    {name: value for name, value in given.items() if name not in params},
                )
            current = base

    # --- names

    def _renamed(self, node: _Node) -> _Node:
        """Return a node with the parts of sequences called by names that a text can have."""
        return self._changed(node, is_part=False)  # type: ignore[no-any-return]

    def _changed(self, node: Any, *, is_part: bool) -> Any:
        match node:
            case ast.TransitionDecl(condition=condition, through=ast.By() as through):
                whole = ast.Infix(operator="and", left=condition, right=through, start=0, end=0)
                return self._changed(replace(node, condition=whole, through=None), is_part=False)
            case ast.NameNode(text=text):
                return replace(node, text=self.names.get(text, text))
            case ast.Reference(path=path):
                return replace(node, path=self._path(path, is_part))
            case tuple():
                return tuple(self._changed(part, is_part=is_part) for part in node)
            case Record():
                changes = {}
                for field in fields(node):  # type: ignore[arg-type]
                    value = getattr(node, field.name)
                    if isinstance(value, Record | tuple):
                        changes[field.name] = self._changed(value, is_part=_is_part(node, field.name))
                return replace(node, **changes) if changes else node  # type: ignore[type-var]
            case _:
                return node

    def _path(self, path: tuple[str, ...], is_part: bool) -> tuple[str, ...]:
        if path[0] == "last":
            return ("last", *self._path(path[1:], True)) if len(path) > 1 else path
        if len(path) == 1:
            return (self.names.get(path[0], path[0]),)
        name = ".".join(path[:2])
        is_member = len(path) == 3 and path[0] in self.sequences
        return (self.names[name], *path[2:]) if name in self.names and (is_part or is_member) else path


def _is_part(node: Record, field: str) -> bool:
    """Return True if references in a field of a node name parts of the network, not values."""
    match node:
        case ast.By():
            return True
        case ast.Is() | ast.WireDecl() | ast.ChainNode():
            return field in ("subject", "wiring", "operands")
        case ast.DerivedModuleDecl():
            return field == "base"
        case _:
            return False


def _dotted(node: ast.Declaration) -> Iterator[str]:
    """Yield the names with a dot that a declaration declares."""
    names: Sequence[ast.NameNode] = ()
    if isinstance(node, ast.NetworkDecl):
        names = [wire.name for wire in node.wires]
    elif isinstance(node, ast.NamedNode):
        names = [node.name]
    yield from (name.text for name in names if "." in name.text)


class _Qualifier:
    """Lets a text of another file say the same in the main file: its names get the way to that file."""

    def __init__(self, home: FileScope, root: FileScope, text: ast.ModuleDecl | None = None) -> None:
        self.home = home
        self.root = root
        self.text = text
        self.local = set[str]() if text is None else _local_names(text)

    def module(self) -> ast.ModuleDecl:
        """Return the module."""
        assert self.text is not None
        return self.text if self.home is self.root else self._changed(self.text)

    def expression(self, node: ast.Expression) -> ast.Expression:
        """Return an expression."""
        self.local = set(_variables(node))
        return node if self.home is self.root else self._changed(node)

    def _changed(self, node: Any) -> Any:
        match node:
            case ast.Reference(path=path) | ast.TypeName(path=path):
                return replace(node, path=self._path(path))
            case ast.CallNode(function=function):
                name = replace(function, text=".".join(self._path(tuple(function.text.split(".")))))
                return self._children(replace(node, function=name))
            case tuple():
                return tuple(map(self._changed, node))
            case Record():
                return self._children(node)
            case _:
                return node

    def _children(self, node: Any) -> Any:
        changes = {
            field.name: self._changed(value)
            for field in fields(node)
            if isinstance(value := getattr(node, field.name), Record | tuple)
        }
        return replace(node, **changes) if changes else node

    def _path(self, path: tuple[str, ...]) -> tuple[str, ...]:
        if path[0] in self.local:
            return path
        inner, rest = self.home.resolve(path)
        owner = inner.visible_values.get(rest[0])
        if owner is None or is_private(rest[0]):
            return path
        return (*owner.full_name(rest[0]).split("."), *rest[1:])


def _local_names(text: ast.ModuleDecl) -> set[str]:
    return {c.name.text for c in text.clauses} | set(_variables(text))


def _variables(node: object) -> Iterator[str]:
    """Yield the variables of reductions and the parameters of functions in a node."""
    work = [node]
    while work:
        part = work.pop()
        if isinstance(part, ast.Comprehension | ast.ElementsComprehension):
            yield part.variable.text
        if isinstance(part, ast.ElementsComprehension) and part.bearing is not None:
            yield part.bearing.text
        if isinstance(part, ast.FunctionDecl):
            yield from (parameter.name.text for parameter in part.parameters)
        if isinstance(part, tuple):
            work += part
        elif isinstance(part, Record):
            work += [getattr(part, f.name) for f in fields(part)]  # type: ignore[arg-type]
