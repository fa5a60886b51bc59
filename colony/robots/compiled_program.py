"""Compiled programs with the files of their modules in Python: made from a program, saved, and read."""

from __future__ import annotations

from collections.abc import Callable

from colony.compile.pipeline import Compilation, compile_program
from colony.execute.colonyc import read, unusable
from colony.execute.compiled import Compiled
from colony.files import StrPath
from colony.ir.program import Program, PythonModule
from colony.robots.python_sources import changed_sources, python_sources
from colony.text.diagnostics import Failure


def compiled_with_sources(program: Program, report: Callable[[str], None]) -> Compilation:
    """Compile a program; its artifact has all sources, so that a recording can be audited by itself.

    Modules in Python are looked for in `sys.path`. `report` is told of files that cannot be read, which are
    left out.
    """
    modules = (module.module_path for module in program.modules if isinstance(module, PythonModule))
    return compile_program(program, python_sources(modules, report))


def read_compiled(path: StrPath) -> Compiled:
    """Read a compiled program whose modules in Python, in `sys.path`, are those that it was compiled with.

    Raises:
        Failure: C001, it cannot be read, holds none that could be run, or has another module in Python.
    """
    compiled = read(path)
    changed = changed_sources(compiled)
    if changed:
        raise Failure([unusable(str(path), f"`{changed[0]}` has changed since it was compiled")])
    return compiled
