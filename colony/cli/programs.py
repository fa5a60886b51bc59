"""Compiled programs for the commands that run them: from a behavior, or from a `*.colonyc` file."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from colony.cli.reporting import load_program, refuse, say
from colony.compile.pipeline import Compilation
from colony.execute.colonyc import is_compiled
from colony.execute.compiled import Compiled
from colony.robots.compiled_program import compiled_with_sources, read_compiled
from colony.text.diagnostics import DiagnosticError


def load_compiled(path: str) -> Compiled:
    """Return the compiled program of a file, with its sources; Python modules are searched for beside it.

    Exits with 2 if the file cannot be read or is damaged, with 1 if it has errors.
    """
    if not is_compiled(path):
        return compile_file(path).compiled
    sys.path += [str(Path(path).resolve().parent), os.curdir]
    try:
        return read_compiled(path)
    except DiagnosticError as failure:
        refuse(failure.diagnostics)


def compile_file(path: str) -> Compilation:
    """Compile a behavior with its sources. Exits like `load_compiled`."""
    return compiled_with_sources(load_program(path), say)
