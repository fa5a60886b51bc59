"""Replay of recorded frames by any executor; it resumes after damaged sections if the memory is known."""

from __future__ import annotations

from typing import Literal

from colony.analysis.audit import Recorded, RecordedMemory
from colony.analysis.resuming import Resuming
from colony.compile.pipeline import compile_program
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import Executor, Outcome
from colony.ir.program import Program
from colony.text.wording import time_text
from colony.verify.reference.interpreter import Interpreter

Backend = Literal["network", "clients", "python"]


class Decider:
    """Decides frames, and resumes after damage where possible.

    Stateful: holds the executor, the damaged sections, and the number of frames that were not decided.

    Args:
        program: the program of the recording.
        backend: the executor: the reference interpreter, the client list, or the generated Python.
    """

    def __init__(self, program: Program, backend: Backend) -> None:
        self._program, self._backend = program, backend
        self._resuming = Resuming(program)
        self._executor: Executor | None = self._new_executor()
        self._last_ns: int | None = None
        self.damage: list[str] = []
        self.undecided = 0

    def step(self, recorded: Recorded) -> Outcome | None:
        """Decide a frame; return None if the memory is not known."""
        tick = recorded.tick
        if recorded.damaged or (self._last_ns is None and tick.k != tick.start):
            self._executor = None
        if recorded.damaged:
            self._record_damage(f"to {time_text(recorded.frame.t_ns)}")
        self._last_ns = recorded.frame.t_ns
        if recorded.restart or recorded.frame.restarted:
            self._executor = self._new_executor()
        elif recorded.memory_unknown:
            self._executor = None
        elif self._executor is None and recorded.keyframe is not None:
            self._executor = self._resume(recorded.keyframe)
        if self._executor is None:
            self.undecided += 1
            return None
        return self._executor.step(recorded.frame)

    def active_modules(self) -> tuple[str, ...] | None:
        """Return the modules that were active in the last frame; None unless the interpreter decided it.

        Call it after the first frame.
        """
        executor = self._executor
        return executor.active_modules() if isinstance(executor, Interpreter) else None

    def end(self, *, damaged: bool) -> None:
        """If `damaged`, record that the recording is damaged after the last frame."""
        if damaged:
            self._record_damage("to its end")

    def _new_executor(self) -> Executor:
        if self._backend == "network":
            return Interpreter(self._program)
        compiled = compile_program(self._program).compiled
        if self._backend == "clients":
            return ProgramExecutor(compiled)
        from colony.compile.backends.python.generate import generate, load

        return load(generate(compiled))

    def _resume(self, keyframe: RecordedMemory) -> Executor | None:
        if self._backend != "network" or keyframe.memory is None:
            return None
        try:
            return self._resuming.interpreter(keyframe.memory)
        except ValueError:
            return None

    def _record_damage(self, end: str) -> None:
        start = "" if self._last_ns is None else f" from {time_text(self._last_ns)}"
        self.damage.append(f"damaged{start} {end}")
