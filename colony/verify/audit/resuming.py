"""The reference interpreter, going on from memory that was recorded."""

from __future__ import annotations

from colony.compile.pipeline import compile_program
from colony.execute.executor import ProgramExecutor
from colony.ir.memory import ProgramMemory
from colony.ir.program import Program
from colony.verify.reference.interpreter import Interpreter


class Resuming:
    """A maker of interpreters that resume from recorded memory. Mutable: the clients that check it.

    `answered` is as for `Interpreter`.
    """

    def __init__(self, program: Program, *, answered: bool = False) -> None:
        self._program, self._answered = program, answered
        self._clients: ProgramExecutor | None = None

    def interpreter(self, memory: ProgramMemory) -> Interpreter:
        """Return an interpreter that has this memory.

        Raises:
            ValueError: it is not the memory of the program, or the interpreter is to run modules in Python,
                which have memory of their own.
            DiagnosticError: a module in Python cannot be imported or built.
        """
        self._clients = self._clients or ProgramExecutor(
            compile_program(self._program).compiled, simplified=False, answered=self._answered
        )
        self._clients.resume(memory)
        interpreter = Interpreter(self._program, answered=self._answered)
        interpreter.resume(memory)
        return interpreter
