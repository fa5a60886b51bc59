"""Names that no declaration may have, because the language gives them a meaning."""

from __future__ import annotations

from collections.abc import Iterator

from colony.dsl import ast
from colony.dsl.check.scope import Report, Scope
from colony.ir.program import SENT

RESTARTED = "restarted"
"""Name of the value that is true in the first frame after memory was lost."""

RESERVED_NAMES = {
    RESTARTED: "it is true in the first frame after memory was lost",
    SENT: "`last.ACTUATOR.FIELD` is what an actuator was given in the frame before",
}
"""The reserved names, each with its meaning."""


def reject_reserved_names(report: Report, scope: Scope) -> None:
    """Report each declaration of a file that has a reserved name."""
    for name in _declared_names(scope):
        reject_reserved_name(report, scope, name)


def reject_reserved_name(report: Report, scope: Scope, name: ast.Name) -> None:
    """Report a name that is reserved."""
    meaning = RESERVED_NAMES.get(name.text)
    if meaning is not None:
        message = f"`{name.text}` is a reserved name: {meaning}"
        report.error(scope, "E109", name, message, "choose another name")


def _declared_names(scope: Scope) -> Iterator[ast.Name]:
    """Yield the names of values, parts and aliases that a file declares."""
    for node in scope.file.tree.declarations:
        match node:
            case ast.RobotDecl(items=items):
                yield from (item.name for item in items if not isinstance(item, ast.FrameDecl))
            case ast.NetworkDecl(wires=wires):
                yield from (wire.name for wire in wires)
            case ast.ImportDecl(alias=ast.Name() as alias):
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
                | ast.ParamDecl()
                | ast.LetDecl()
                | ast.StateDecl()
                | ast.MachineDecl()
                | ast.DerivedModuleDecl()
            ):
                yield node.name
            case _:
                pass
