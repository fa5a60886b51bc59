"""The source of the functions and classes that generated programs include.

They are those of the plain executor, so that each has a single definition. Annotations are removed, since
they would need imports.
"""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Iterable
from functools import cache
from types import ModuleType

from colony.execute import arithmetic, intake, python_step, settle
from colony.ir import angles

_MATH = frozenset(name for name in dir(math) if not name.startswith("_"))
_MODULES: tuple[ModuleType, ...] = (angles, arithmetic, intake, python_step, settle)


def support(names: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the definitions called `names` with their dependencies, and the names needed from `math`.

    `names` may include names from `math`; unknown names are ignored.
    """
    definitions = _definitions()
    needed: set[str] = set()
    pending = list(names)
    while pending:
        name = pending.pop()
        if name not in needed:
            needed.add(name)
            pending.extend(_names_in(definitions[name]) if name in definitions else ())
    texts = [ast.unparse(node) for name, node in definitions.items() if name in needed]
    return texts, sorted(name for name in needed if name in _MATH and name not in definitions)


@cache
def _definitions() -> dict[str, ast.FunctionDef | ast.ClassDef]:
    """Return the definitions by name, dependencies first."""
    definitions: dict[str, ast.FunctionDef | ast.ClassDef] = {}
    for module in _MODULES:
        for node in ast.parse(inspect.getsource(module)).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                definitions[node.name] = _without_annotations(node)
    return definitions


def _names_in(node: ast.AST) -> set[str]:
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}


def _without_annotations(node: ast.FunctionDef | ast.ClassDef) -> ast.FunctionDef | ast.ClassDef:
    """Return the definition without annotations."""
    stripped = _AnnotationRemover().visit(node)
    assert isinstance(stripped, ast.FunctionDef | ast.ClassDef)
    return stripped


class _AnnotationRemover(ast.NodeTransformer):
    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        node.returns = None
        self.generic_visit(node)
        return node

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.ClassDef:
        node.bases = [b.value if isinstance(b, ast.Subscript) else b for b in node.bases]
        self.generic_visit(node)
        return node

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.annotation = None
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST | None:
        if node.value is None:
            return None
        return ast.copy_location(ast.Assign([node.target], node.value), node)


def definition_names() -> frozenset[str]:
    """Return the names of all definitions that a generated program may include."""
    return frozenset(_definitions())
