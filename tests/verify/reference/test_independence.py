"""The reference shares no code with what it is the reference for."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import colony.verify.reference

FILES = sorted(Path(colony.verify.reference.__path__[0]).glob("[a-z]*.py"))


@pytest.mark.parametrize("path", FILES, ids=[path.name for path in FILES])
def test_imports(path: Path) -> None:
    imported = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            imported.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            imported.add(node.module or "")
    ours = {name for name in imported if name.startswith("colony")}
    allowed = ("colony.ir", "colony.verify.reference.", "colony.text.diagnostics", "colony.text.source")
    assert all(name.startswith(allowed) for name in ours), ours


def test_all_of_it_is_looked_at() -> None:
    assert len(FILES) == 5
