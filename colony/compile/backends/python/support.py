"""The source of the functions and classes that generated programs include.

They are those of the plain executor, so each is defined once. Annotations are removed, since they would need
imports.
"""

from __future__ import annotations

import ast
import inspect
import math
from collections.abc import Iterable
from functools import cache
from types import ModuleType

from colony.execute import arithmetic, intake, python_step, settle

_MATH = frozenset(name for name in dir(math) if not name.startswith("_"))
_MODULES: tuple[ModuleType, ...] = (arithmetic, intake, python_step, settle)


def support(names: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the definitions called `names` with their dependencies, and the names needed from `math`.

    `names` may include names from `math`; unknown names are ignored.
    """
    definitions = _definitions()
    wanted: set[str] = set()
    work = list(names)
    while work:
        name = work.pop()
        if name not in wanted:
            wanted.add(name)
            work.extend(_mentioned(definitions[name]) if name in definitions else ())
    texts = [ast.unparse(node) for name, node in definitions.items() if name in wanted]
    return texts, sorted(name for name in wanted if name in _MATH and name not in definitions)


@cache
def _definitions() -> dict[str, ast.FunctionDef | ast.ClassDef]:
    """Return the definitions by name, each after those that it needs."""
    found: dict[str, ast.FunctionDef | ast.ClassDef] = {}
    for module in _MODULES:
        for node in ast.parse(inspect.getsource(module)).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                found[node.name] = _without_annotations(node)
    return found


def _mentioned(node: ast.AST) -> set[str]:
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}


def _without_annotations(node: ast.FunctionDef | ast.ClassDef) -> ast.FunctionDef | ast.ClassDef:
    """Return the definition without annotations."""
    bare = _AnnotationRemover().visit(node)
    assert isinstance(bare, ast.FunctionDef | ast.ClassDef)
    return bare


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
