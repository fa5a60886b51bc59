"""A behavior ready to be run by the thousand: compiled once a process, its sensors and actuators bound."""

from __future__ import annotations

from dataclasses import dataclass

from colony.compile.backends.python.executor import PythonExecutor
from colony.compile.backends.python.generate import generate, load
from colony.compile.pipeline import compile_program
from colony.ir.program import Program
from colony.runtime.protocol.bindings import Bindings, bind


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Behavior:
    """A program, where its sensors and actuators are, and its generated Python: `source`, and loaded.

    `first` is never stepped: `executor` makes another one like it, in the initial memory.
    """

    program: Program
    bindings: Bindings
    source: str
    first: PythonExecutor

    def executor(self) -> PythonExecutor:
        """One in the initial memory."""
        return PythonExecutor(type(self.first.program)())


def behavior_from(program: Program) -> Behavior:
    """Compile a program.

    Raises:
        Failure: it is bound to what no server has, or a module in Python cannot be built.
    """
    clients = compile_program(program).clients
    source = generate(program, clients)
    return Behavior(program=program, bindings=bind(program), source=source, first=load(source))
