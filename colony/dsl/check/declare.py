"""Declaration of the names of every file, and of imported names, before anything is checked."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import fields

from colony.dsl import ast
from colony.dsl.check.scope import (
    CheckReport,
    FileScope,
    ModuleSymbol,
    SequenceSymbol,
    WireSymbol,
    is_private,
    label,
)
from colony.ir.program import SENT
from colony.record import Record

# --- reserved -----------------------------------------------------------------------------------------
#
# Names that no declaration may have, because the language gives them a meaning.

RESTARTED = "restarted"
"""Name of the value that is true in the first frame after memory was lost."""

RESERVED_NAMES = {
    RESTARTED: "it is true in the first frame after memory was lost",
    SENT: "`last.ACTUATOR.FIELD` is what an actuator was given in the frame before",
}
"""The reserved names, each with its meaning."""


def reject_reserved_names(report: CheckReport, scope: FileScope) -> None:
    """Report each declaration of a file that has a reserved name."""
    for name in _declared_names(scope):
        reject_reserved_name(report, scope, name)


def reject_reserved_name(report: CheckReport, scope: FileScope, name: ast.NameNode) -> None:
    """Report a name that is reserved."""
    meaning = RESERVED_NAMES.get(name.text)
    if meaning is not None:
        message = f"`{name.text}` is a reserved name: {meaning}"
        report.error(scope, "E109", name, message, "choose another name")


def _declared_names(scope: FileScope) -> Iterator[ast.NameNode]:
    """Yield the names of values, parts and aliases that a file declares."""
    for node in scope.file.tree.declarations:
        match node:
            case ast.RobotDecl(items=items):
                yield from (item.name for item in items if not isinstance(item, ast.FrameDecl))
            case ast.NetworkDecl(wires=wires):
                yield from (wire.name for wire in wires)
            case ast.ImportDecl(alias=ast.NameNode() as alias):
                yield alias
            case ast.ModuleDecl(clauses=clauses) | ast.PythonModuleDecl(clauses=clauses):
                yield node.name
                local = (ast.InputDecl, ast.ParamDecl, ast.LetDecl, ast.FunctionDecl, ast.StateDecl)
                yield from (clause.name for clause in clauses if isinstance(clause, local))
                functions = [clause for clause in clauses if isinstance(clause, ast.FunctionDecl)]
                yield from (p.name for function in functions for p in function.parameters)
            case ast.FunctionDecl(parameters=parameters):
                yield node.name
                yield from (p.name for p in parameters)
            case (
                ast.EnumDecl()
                | ast.SensorDecl()
                | ast.ParamDecl()
                | ast.LetDecl()
                | ast.StateDecl()
                | ast.MachineDecl()
                | ast.SequenceDecl()
                | ast.AssumeDecl()
                | ast.DerivedModuleDecl()
            ):
                yield node.name
            case _:
                pass


# --- declare ------------------------------------------------------------------------------------------

VALUE_DECLARATIONS = (
    ast.SensorDecl,
    ast.EnumDecl,
    ast.ParamDecl,
    ast.LetDecl,
    ast.FunctionDecl,
    ast.StateDecl,
    ast.MachineDecl,
    ast.SequenceDecl,
    ast.AssumeDecl,
)
MODULE_DECLARATIONS = (ast.ModuleDecl, ast.DerivedModuleDecl, ast.PythonModuleDecl)
ModuleNode = ast.ModuleDecl | ast.DerivedModuleDecl | ast.PythonModuleDecl


def declare_names(report: CheckReport, scopes: list[FileScope]) -> None:
    """Fill in the visible names of every scope; report names declared twice, in a file or by an import."""
    sensors, actuators = _robot_names(scopes)
    _name_private(scopes)
    for scope in scopes:
        scope.robot.sensor_names, scope.robot.actuator_names = sensors, actuators
        reject_reserved_names(report, scope)
        _declare(report, scope)
    _name_actuator_wires(scopes)
    by_key = {scope.file.key: scope for scope in scopes}
    for scope in scopes:  # imported files come before their importers
        scope.lost_names |= scope.file.lost_names
        for import_ in scope.file.imports:
            target = by_key.get(import_.target)
            if target is None:
                _allow_unknown_names(scope, import_.declaration)
            elif target is not scope:
                _import_names(report, scope, target, import_.declaration)


def _robot_names(scopes: list[FileScope]) -> tuple[set[str], set[str]]:
    """Return the names of all sensors and actuators that the program declares, even if invalid."""
    sensors: set[str] = set()
    actuators: set[str] = set()
    for scope in scopes:
        for declaration in scope.file.tree.declarations:
            if isinstance(declaration, ast.RobotDecl):
                for item in declaration.items:
                    if isinstance(item, ast.SensorDecl):
                        sensors.add(item.name.text)
                    elif isinstance(item, ast.ActuatorDecl):
                        actuators.add(item.name.text)
    return sensors, actuators


def _declare(report: CheckReport, scope: FileScope) -> None:
    """Declare the names of a file; values get their symbols later, when they are checked."""
    sensors, actuators = scope.robot.sensor_names, scope.robot.actuator_names
    values: dict[str, ast.NameNode] = {}
    network_names: dict[str, ast.NameNode] = {}
    for node in scope.file.tree.declarations:
        if isinstance(node, VALUE_DECLARATIONS):
            is_sensor = isinstance(node, ast.SensorDecl) or (
                isinstance(node, ast.ParamDecl) and node.interval is not None
            )
            if node.name.text in sensors:
                report.error(scope, "E102", node.name, f"the robot has a sensor `{node.name.text}` already")
            elif not (
                is_sensor and _is_actuator(report, scope, node.name, actuators)  # recordings have both
            ) and _declare_once(report, scope, values, node.name):
                scope.visible_values[node.name.text] = scope
                if isinstance(node, ast.EnumDecl) or (
                    isinstance(node, ast.ParamDecl) and node.interval is None
                ):
                    scope.constant_names.add(node.name.text)
                if isinstance(node, ast.SequenceDecl):
                    _declare_sequence(report, scope, node.name, network_names, actuators)
        elif isinstance(node, MODULE_DECLARATIONS):
            if not _is_actuator(report, scope, node.name, actuators) and _declare_once(
                report, scope, network_names, node.name
            ):
                full_name = scope.full_name(node.name.text)
                scope.network_symbols[node.name.text] = ModuleSymbol(
                    name=full_name, actuator=None, members={}
                )
                scope.visible_network_symbols[node.name.text] = scope
        elif isinstance(node, ast.NetworkDecl):
            for wire in node.wires:
                _declare_wire(report, scope, wire.name, network_names, actuators)


def _is_actuator(report: CheckReport, scope: FileScope, name: ast.NameNode, actuators: set[str]) -> bool:
    """Return True if a name is that of an actuator, after reporting that."""
    if name.text not in actuators:
        return False
    report.error(scope, "E102", name, f"the robot has an actuator `{name.text}` already")
    return True


def _declare_sequence(
    report: CheckReport,
    scope: FileScope,
    name: ast.NameNode,
    network_names: dict[str, ast.NameNode],
    actuators: set[str],
) -> None:
    """Declare the name of a sequence as that of a part, as which its tasks and wires are found."""
    if not _is_actuator(report, scope, name, actuators) and _declare_once(report, scope, network_names, name):
        scope.network_symbols[name.text] = SequenceSymbol(name=scope.full_name(name.text))
        scope.visible_network_symbols[name.text] = scope


def _declare_wire(
    report: CheckReport,
    scope: FileScope,
    name: ast.NameNode,
    network_names: dict[str, ast.NameNode],
    actuators: set[str],
) -> None:
    if name.text in actuators:
        if name.text in network_names:
            first = label(scope, network_names[name.text], "first driven here")
            report.error(scope, "E503", name, f"actuator `{name.text}` is driven twice", None, first)
        network_names.setdefault(name.text, name)
        scope.actuator_wires[name.text] = WireSymbol(name=name.text)
    elif _declare_once(report, scope, network_names, name):
        scope.network_symbols[name.text] = WireSymbol(name=scope.full_name(name.text))
        scope.visible_network_symbols[name.text] = scope


def _name_private(scopes: list[FileScope]) -> None:
    """Give the private names of each file full names; those of several files may be spelled alike."""
    taken: set[str] = set()
    for scope in reversed(scopes):  # importing files take short names first
        prefix, stem = scope.file.prefix, _identifier(scope.file.stem)
        for private in sorted(set(filter(is_private, _own_names(scope)))):
            name, count = f"{prefix}{private}", 1
            while name in taken:
                name = f"{prefix}{stem}:{private}" if count == 1 else f"{prefix}{stem}:{private}:{count}"
                count += 1
            taken.add(name)
            scope.private_names[private] = name


def _identifier(stem: str) -> str:
    """Return the name of a file as a part of names, in the characters that names have."""
    written = re.sub(r"\W", "_", stem)[:255]
    return written if written[:1].isidentifier() else f"_{written}"


def _own_names(scope: FileScope) -> Iterator[str]:
    """Yield the names of values, parts, contracts and aliases that a file declares."""
    for node in scope.file.tree.declarations:
        if isinstance(node, ast.NetworkDecl):
            yield from (wire.name.text for wire in node.wires)
        elif isinstance(node, ast.ImportDecl):
            yield from () if node.alias is None else (node.alias.text,)
        elif isinstance(node, (*VALUE_DECLARATIONS, *MODULE_DECLARATIONS, ast.ContractDecl)):
            yield node.name.text


def _name_actuator_wires(scopes: list[FileScope]) -> None:
    """Name the wire of each actuator after the actuator.

    In files that are imported without an alias, it may need a longer name.
    """
    taken = set(scopes[-1].robot.actuator_names)
    for scope in reversed(scopes):  # importing files take short names first
        prefix, stem = scope.file.prefix, _identifier(scope.file.stem)
        for actuator in scope.actuator_wires:
            name, count = f"{prefix}{actuator}", 1
            while name in taken and not scope.file.is_root:
                name = f"{prefix}{stem}:{actuator}" if count == 1 else f"{prefix}{stem}:{actuator}:{count}"
                count += 1
            taken.add(name)
            scope.actuator_wires[actuator] = WireSymbol(name=name)


def _allow_unknown_names(scope: FileScope, node: ast.ImportDecl | ast.RobotImportDecl) -> None:
    """Suppress errors about names that the unreadable imported file may declare."""
    if node.alias is None:
        scope.incomplete = True
    else:
        scope.lost_names.add(node.alias.text)


def _declare_once(
    report: CheckReport, scope: FileScope, names: dict[str, ast.NameNode], name: ast.NameNode
) -> bool:
    first = names.get(name.text)
    if first is None:
        names[name.text] = name
        return True
    report.error(scope, "E102", name, f"`{name.text}` is declared twice", None, label(scope, first))
    return False


def _import_names(
    report: CheckReport, scope: FileScope, target: FileScope, node: ast.ImportDecl | ast.RobotImportDecl
) -> None:
    """Import all names of a file, under its alias if the import has one."""
    alias = node.alias
    if alias is not None:
        robot = scope.robot
        file_names = (scope.aliases, scope.visible_values, scope.visible_network_symbols)
        robot_names = (robot.sensor_names, robot.actuator_names)
        is_taken = any(alias.text in names for names in (*file_names, *robot_names))
        if is_taken and scope.aliases.get(alias.text) is not target:
            report.error(scope, "E102", alias, f"`{alias.text}` is declared twice", "choose another alias")
        scope.aliases.setdefault(alias.text, target)
        return
    scope.lost_names |= target.lost_names
    scope.incomplete |= target.incomplete
    scope.private_owners.update(target.private_owners)
    for own, imported in (
        (scope.visible_values, target.visible_values),
        (scope.visible_network_symbols, target.visible_network_symbols),
        (scope.aliases, target.aliases),
    ):
        for name, owner in imported.items():
            if is_private(name):
                scope.private_owners[name] = target.file.source.name
            elif own.setdefault(name, owner) is not owner:
                message = f"`{name}` is declared here and in `{target.file.source.name}`"
                hint = "rename one of them"
                if isinstance(node, ast.ImportDecl):
                    hint += f', or write `import "{node.path}" as NAME`'
                report.error(scope, "E102", node, message, hint)


# --- texts of modules ---------------------------------------------------------------------------------


def modules_declared(scopes: list[FileScope]) -> dict[str, tuple[FileScope, ModuleNode]]:
    """Return the declarations of all modules of a program, each with its file, by full name."""
    found: dict[str, tuple[FileScope, ModuleNode]] = {}
    for scope in scopes:
        for node in scope.file.tree.declarations:
            if isinstance(node, MODULE_DECLARATIONS):
                found.setdefault(scope.full_name(node.name.text), (scope, node))
    return found


def text_of(
    scope: FileScope, node: ModuleNode, modules: Mapping[str, tuple[FileScope, ModuleNode]]
) -> tuple[FileScope, ast.ModuleDecl | ast.PythonModuleDecl | None, bool]:
    """Return the declaration that a module, which may be derived, has its text from, and its file.

    The last value is true if it, or a module that it is derived from, is failsafe. The declaration is None if
    a base is unknown, or derived from itself, which is reported where modules are checked.
    """
    seen: set[str] = set()
    is_failsafe = node.failsafe
    while isinstance(node, ast.DerivedModuleDecl):
        inner, path = scope.resolve_part(node.base.path)
        symbol = inner.network_symbol(path[0]) if len(path) == 1 else None
        if not isinstance(symbol, ModuleSymbol) or symbol.name in seen or symbol.name not in modules:
            return scope, None, is_failsafe
        seen.add(symbol.name)
        scope, node = modules[symbol.name]
        is_failsafe = is_failsafe or node.failsafe
    return scope, node, is_failsafe


def references_in(node: ast.SyntaxNode) -> Iterator[ast.Reference]:
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
