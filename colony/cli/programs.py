"""Programs for the commands that compile and run them: from a behavior, or from a `*.colonyc` file."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from colony.cli.body_check import BodyCheck
from colony.cli.reporting import exit_with, load_program, refuse, say
from colony.compile.pipeline import Compilation
from colony.execute.compiled import Compiled
from colony.runs.compiled import compiled_with_sources, read_compiled
from colony.text.diagnostics import DiagnosticError

if TYPE_CHECKING:
    from colony.ir.program import Robot
    from colony.runs.described import DescribedRobot


def load_compiled(path: str) -> Compiled:
    """Return the program of a `*.colonyc` file; Python modules are searched for beside it.

    Exits with 2 if the file cannot be read or is damaged.
    """
    sys.path += [str(Path(path).resolve().parent), os.curdir]
    try:
        return read_compiled(path)
    except DiagnosticError as failure:
        refuse(failure.diagnostics)


def compile_file(path: str) -> Compilation:
    """Compile a behavior with its sources.

    Exits with 2 if the file cannot be read, with 1 if it has errors or does not fit its body.
    """
    program = load_program(path)
    misfits = BodyCheck().misfits(program)
    if misfits:
        exit_with(misfits)
    return compiled_with_sources(program, say)


def compile_for_run(path: str) -> tuple[Compilation, DescribedRobot]:
    """Compile a behavior with its sources; return its robot, too. Exits like `compile_file`."""
    program = load_program(path)
    described = described_for_run(program.robot)
    return compiled_with_sources(program, say), described


def described_for_run(robot: Robot, body: Path | None = None) -> DescribedRobot:
    """Return the robot that a program runs on; see `described_robot`.

    Exits with 1 if the program does not fit its body.
    """
    from colony.runs.described import described_robot

    try:
        return described_robot(robot, body)
    except DiagnosticError as failure:
        exit_with(failure.diagnostics)
