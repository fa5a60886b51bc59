"""Compiled programs with all that they need elsewhere: the robot's body, and the files of Python modules."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import PurePosixPath

from colony.body.reader import MAX_BYTES
from colony.compile.pipeline import Compilation, compile_program
from colony.dsl.descriptions import find_body
from colony.execute.colonyc import read, unusable
from colony.execute.compiled import Compiled, SourceFile
from colony.files import StrPath, read_file, reason
from colony.ir.program import Program, PythonModule
from colony.robots.python_sources import changed_sources, python_sources
from colony.text.diagnostics import DiagnosticError


def compiled_with_sources(program: Program, report: Callable[[str], None]) -> Compilation:
    """Compile a program with all its sources, so that a recording can be audited on its own.

    The robot's body is the one beside its interface, and Python modules are found on `sys.path`. `report`
    takes a warning about each file that cannot be read, which is left out.
    """
    modules = (module.module_path for module in program.modules if isinstance(module, PythonModule))
    return compile_program(program, (*_body(program, report), *python_sources(modules, report)))


def _body(program: Program, report: Callable[[str], None]) -> Iterator[SourceFile]:
    """Yield the file of the robot's body, if it has one and the program has the file of its interface."""
    interfaces = [path for path, source in program.files if source == program.robot.span.source]
    file = find_body(program.robot) if interfaces else None
    if file is None:
        return
    try:
        data = read_file(file, MAX_BYTES)
    except OSError as problem:
        report(f"{file}: warning: cannot be included in the recording: {reason(problem)}")
        return
    yield SourceFile(kind="body", path=str(PurePosixPath(interfaces[0]).with_name(file.name)), data=data)


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
