"""Compiled programs for the commands that run them: from a behavior, or from a file `*.colonyc`."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from colony.cli.reporting import check_to_run, expect_program, refuse, say
from colony.compile.pipeline import Compilation, compile_program
from colony.execute.artifact import is_compiled, read, unusable
from colony.execute.compiled import Compiled
from colony.robots.python_sources import changed_sources
from colony.robots.recorded_program import program_sources
from colony.text.diagnostics import Failure


def load_compiled(path: str) -> Compiled:
    """Return the compiled program of a file, with its sources; modules in Python are looked for beside it.

    Exits with 2 where the file cannot be read or is damaged, with 1 where there are errors in it.
    """
    if not is_compiled(path):
        return compile_file(path).artifact
    try:
        compiled = read(path)
    except Failure as failure:
        refuse(failure.diagnostics)
    sys.path += [str(Path(path).resolve().parent), os.curdir]
    changed = changed_sources(compiled)
    if changed:
        refuse([unusable(path, f"`{changed[0]}` has changed since it was compiled")])
    return compiled


def compile_file(path: str) -> Compilation:
    """Compile a behavior; its artifact has the sources. Exits as `load_compiled`."""
    checked = check_to_run(path)
    program = expect_program(checked)
    root, sources = program_sources(path, program, checked.tree, say)
    return compile_program(program, sources, root)
