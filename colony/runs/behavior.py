"""Behaviors compiled once per process, for thousands of runs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from colony.compile.backends.python.executor import PythonExecutor
from colony.compile.backends.python.generate import generate, load
from colony.compile.pipeline import compile_program
from colony.dsl.descriptions import RobotChoice
from colony.dsl.load import load_file
from colony.ir.program import Program, Robot, robot_in_base_units

SIMULATED = RobotChoice(text="rome", origin="the simulator", is_name=True)
"""The robot that is simulated: that of behaviors with `import robot`."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Behavior:
    """A robot, its program in base units, and the Python source generated from it.

    `prototype` is the loaded source. It is never stepped; `executor` creates executors like it, with initial
    memory.
    """

    robot: Robot
    program: Program
    source: str
    prototype: PythonExecutor

    def executor(self) -> PythonExecutor:
        """Return an executor with initial memory."""
        return PythonExecutor(type(self.prototype.program)())


@lru_cache(maxsize=8)
def behavior_of(path: Path) -> Behavior:
    """Load and compile a behavior.

    Raises:
        DiagnosticError: it has errors, or a module in Python cannot be built.
    """
    return behavior_from(load_file(path, robot=SIMULATED))


def behavior_from(program: Program) -> Behavior:
    """Compile a program.

    Raises:
        DiagnosticError: a module in Python cannot be built.
    """
    in_base = replace(program, robot=robot_in_base_units(program.robot))
    source = generate(compile_program(in_base).compiled)
    return Behavior(robot=program.robot, program=in_base, source=source, prototype=load(source))
