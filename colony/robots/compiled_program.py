"""Compiled programs with the files of their Python modules: compilation and reading."""

from __future__ import annotations

from collections.abc import Callable

from colony.compile.pipeline import Compilation, compile_program
from colony.execute.colonyc import read, unusable
from colony.execute.compiled import Compiled
from colony.files import StrPath
from colony.ir.program import Program, PythonModule
from colony.robots.python_sources import changed_sources, python_sources
from colony.text.diagnostics import DiagnosticError


def compiled_with_sources(program: Program, report: Callable[[str], None]) -> Compilation:
    """Compile a program with all its sources, so that a recording can be audited on its own.

    Python modules are found on `sys.path`. `report` takes a warning about each file that cannot be read,
    which is left out.
    """
    modules = (module.module_path for module in program.modules if isinstance(module, PythonModule))
    return compile_program(program, python_sources(modules, report))


def read_compiled(path: StrPath) -> Compiled:
    """Read a compiled program, and check that its Python modules on `sys.path` have not changed.

    Raises:
        DiagnosticError: C001, the file cannot be read, contains no executable program, or a Python module has
            changed.
    """
    compiled = read(path)
    changed = changed_sources(compiled)
    if changed:
        raise DiagnosticError([unusable(str(path), f"`{changed[0]}` has changed since it was compiled")])
    return compiled
