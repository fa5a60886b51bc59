"""Imports never run upwards, and starting a part of the system loads no more than that part."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "colony"

BASE = {"colony", "colony.collector", "colony.files", "colony.os_errors", "colony.record"}
ALLOWED: dict[str, set[str]] = {
    "text": set(),
    "ir": set(),
    "dsl": {"ir"},
    "execute": {"ir", "compile"},
    "compile": {"ir", "execute"},
    "verify": {"ir", "execute", "compile", "dsl"},
    "runtime": {"ir", "execute", "compile"},
    "nav": {"runtime"},
    "vision": {"runtime", "nav"},
    "sim": {"runtime", "nav", "ir"},
    "view": {"ir", "compile", "nav"},
    "experiment": {"ir", "dsl", "execute", "compile", "verify", "runtime", "nav", "vision", "sim", "view"},
    "robots": {"ir", "dsl", "compile", "verify", "runtime", "nav", "sim", "experiment"},
    "cli": {
        "ir",
        "dsl",
        "execute",
        "compile",
        "verify",
        "runtime",
        "nav",
        "vision",
        "sim",
        "view",
        "experiment",
        "robots",
    },
}
"""The packages that a package may import, besides itself, `text` and the base."""

THIRD_PARTY: dict[str, set[str]] = {
    "lark": {"dsl"},
    "hypothesis": {"verify"},
    "z3": {"verify"},
    "numba": {"sim"},
    "cv2": {"vision", "sim"},
    "PIL": {"vision", "sim"},
    "dask": {"experiment"},
    "distributed": {"experiment"},
    "matplotlib": {"view"},
    "click": {"cli"},
    "rich": {"cli", "experiment"},
    "networkx": {"view", "compile", "nav"},
    "msgspec": {"runtime", "sim", "experiment", "cli"},
    "zenoh": {"runtime"},
    "mcap": {"runtime"},
    "lz4": {"runtime"},
    "zstandard": {"runtime"},
}
"""The only packages that may import these."""


def _imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            found.add(node.module or "")
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


FRONT = {ROOT / "__init__.py", ROOT / "library.py", ROOT / "testing.py"}
"""The front door, which opens every package but the command line, and which no package imports."""

SOURCES = sorted(ROOT.rglob("*.py"))


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_run_downwards(path: Path) -> None:
    parts = path.relative_to(ROOT).parts
    package = parts[0] if len(parts) > 1 else None
    for name in _imports(path):
        top = name.split(".")[0]
        if top in THIRD_PARTY:
            assert package in THIRD_PARTY[top], f"{path} imports {name}"
        if top != "colony" or name == "colony":
            continue
        target = name.split(".")[1]
        if (ROOT / target).is_dir():
            allowed = {package, "text", *ALLOWED[package]} if package else {"text"}
            allowed = set(ALLOWED) - {"cli"} if path in FRONT else allowed
            assert target in allowed, f"{path} imports {name}"
        elif package is None and path not in FRONT:
            assert f"colony.{target}" in BASE | {"colony.__version__"}, f"{path} imports {name}"


def test_every_package_has_its_place() -> None:
    packages = {p.name for p in ROOT.iterdir() if p.is_dir() and p.name != "__pycache__"}
    assert packages == set(ALLOWED)


def _loaded_by(statement: str) -> set[str]:
    code = f"{statement}; import sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        (
            "import colony.runtime.assembly.virtual",
            {"lark", "colony.dsl", "colony.verify", "z3", "hypothesis", "matplotlib"},
        ),
        ("import colony.dsl.ast", {"lark"}),
        ("import colony.compile.pipeline", {"lark", "numpy", "networkx"}),
        ("import colony.dsl.load", {"lark", "numpy", "networkx", "rich", "hypothesis", "difflib"}),
        ("import colony.cli.main", {"lark", "rich", "numpy", "colony.ir"}),
        ("import colony.cli.check", {"lark", "rich", "numpy"}),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_loads_no_more_than_it_needs(statement: str, absent: set[str]) -> None:
    assert not _loaded_by(statement) & absent
