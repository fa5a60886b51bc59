"""The reference interpreter, resumed from recorded memory."""

from __future__ import annotations

from colony.compile.pipeline import compile_program
from colony.execute.executor import ProgramExecutor
from colony.ir.memory import ProgramMemory
from colony.ir.program import Program
from colony.verify.reference.interpreter import Interpreter


class Resuming:
    """A factory of interpreters that resume from recorded memory. Stateful: caches an executor.

    `answers_given` is as for `Interpreter`.
    """

    def __init__(self, program: Program, *, answers_given: bool = False) -> None:
        self._program, self._answers_given = program, answers_given
        self._clients: ProgramExecutor | None = None

    def interpreter(self, memory: ProgramMemory) -> Interpreter:
        """Return an interpreter with this memory.

        Raises:
            ValueError: the memory is not that of the program, or the interpreter would have to run modules in
                Python, whose memory is not recorded.
            DiagnosticError: a module in Python cannot be imported or built.
        """
        self._clients = self._clients or ProgramExecutor(
            compile_program(self._program).compiled, simplified=False, answers_given=self._answers_given
        )
        self._clients.resume(memory)
        interpreter = Interpreter(self._program, answers_given=self._answers_given)
        interpreter.resume(memory)
        return interpreter
