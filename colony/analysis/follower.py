"""Following a run: before each frame, an executor with the memory of the program, or why there is none.

Memory is initial at the beginning of an epoch, and is carried from frame to frame. It is lost at a frame that
is damaged, that the observer could not place, or in which a module in Python left no answer. After that, and
in a recording that begins in the middle of an epoch, the next keyframe has it again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Literal, NamedTuple, Protocol, TypeVar

from colony.compile.pipeline import compile_program
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import Executor, Outcome, given_in_frame
from colony.ir.memory import ProgramMemory
from colony.ir.program import Program, PythonModule
from colony.runtime.frames.run_frame import Keyframe, RunFrame
from colony.verify.reference.interpreter import Interpreter

Backend = Literal["network", "clients", "python", "c"]
"""An executor: the reference interpreter, the client list, generated Python or C."""

E = TypeVar("E")
E_co = TypeVar("E_co", covariant=True)


class UnknownMemory(NamedTuple):
    """The memory before a frame is not known.

    `reason` is "not observed" if the frame itself says so, "no answer" if the frame lacks the answer of a
    module in Python, and "forgotten" if an earlier frame lost the memory and no keyframe followed.
    """

    reason: Literal["not observed", "no answer", "forgotten"]


@dataclass(frozen=True, slots=True, kw_only=True)
class DamagedSpan:
    """A damaged section of the recording: the times of the intact frames around it, None if there is none."""

    after_ns: int | None
    before_ns: int | None


class Executors(Protocol[E_co]):
    """A factory of executors of a program; `answered` are the modules whose answers they are given."""

    @property
    def answered(self) -> frozenset[str]:
        """The modules in Python that do not run in these executors."""
        ...

    def begin(self) -> E_co:
        """Return an executor with initial memory."""
        ...

    def resume(self, memory: ProgramMemory) -> E_co:
        """Return an executor with this memory.

        Raises:
            ValueError: the memory is not that of the program, or the executor cannot continue from it.
        """
        ...


class Interpreters:
    """A factory of reference interpreters. Stateful: caches an executor that checks memories.

    Args:
        program: the program.
        answers_given: as for `Interpreter`.
    """

    def __init__(self, program: Program, *, answers_given: bool = True) -> None:
        self._program, self._answers_given = program, answers_given
        modules = (m.name for m in program.modules if isinstance(m, PythonModule))
        self.answered = frozenset(modules if answers_given else ())
        self._clients: ProgramExecutor | None = None

    def begin(self) -> Interpreter:
        """Return an interpreter with initial memory.

        Raises:
            DiagnosticError: a module in Python cannot be imported or built.
        """
        return Interpreter(self._program, answers_given=self._answers_given)

    def resume(self, memory: ProgramMemory) -> Interpreter:
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
        interpreter = self.begin()
        interpreter.resume(memory)
        return interpreter


class ProgramExecutors:
    """A factory of executors of the client list, which take a small part of an interpreter's time."""

    def __init__(self, program: Program) -> None:
        self._compiled = compile_program(program).compiled
        self.answered = frozenset(self._compiled.python_modules)

    def begin(self) -> ProgramExecutor:
        """Return an executor with initial memory."""
        return ProgramExecutor(self._compiled, simplified=False, answers_given=True)

    def resume(self, memory: ProgramMemory) -> ProgramExecutor:
        """Return an executor with this memory.

        Raises:
            ValueError: the memory is not that of the program.
        """
        executor = self.begin()
        executor.resume(memory)
        return executor


class BackendExecutors:
    """A factory of executors of any backend, which run modules in Python; only interpreters resume."""

    answered: frozenset[str] = frozenset()

    def __init__(self, program: Program, backend: Backend) -> None:
        self._program, self._backend = program, backend
        self._interpreters = Interpreters(program, answers_given=False)

    def begin(self) -> Executor:
        """Return an executor with initial memory.

        Raises:
            DiagnosticError: a module in Python cannot be imported or built.
        """
        if self._backend == "network":
            return self._interpreters.begin()
        compiled = compile_program(self._program).compiled
        if self._backend == "clients":
            return ProgramExecutor(compiled)
        if self._backend == "c":
            from colony.compile.backends.c.native import load_c

            return load_c(compiled)
        from colony.compile.backends.python.generate import generate, load

        return load(generate(compiled))

    def resume(self, memory: ProgramMemory) -> Executor:
        """Return an executor with this memory.

        Raises:
            ValueError: as by `Interpreters.resume`, or the backend cannot resume.
        """
        if self._backend != "network":
            raise ValueError("only the interpreter continues from a keyframe")
        return self._interpreters.resume(memory)


class Follower(Generic[E]):
    """Keeps an executor in step with a run. Stateful.

    Feed it every frame, in order, and step the executor over each frame for which it returns one.

    Args:
        executors: factory of executors.
        executor: an executor that has stepped over all earlier frames; None to begin without memory.
        trusts_degraded: False to resume only from keyframes of epochs in which no client was lost.

    Attributes:
        executor: the executor; None if the memory is not known.
        has_resumed: True if the executor continued from the keyframe of the last frame.
        damaged: the damaged sections.
    """

    def __init__(
        self, executors: Executors[E], executor: E | None = None, *, trusts_degraded: bool = True
    ) -> None:
        self._executors, self._trusts_degraded = executors, trusts_degraded
        self._last_ns: int | None = None
        self.executor = executor
        self.has_resumed = False
        self.damaged: list[DamagedSpan] = []

    def feed(self, frame: RunFrame) -> E | UnknownMemory:
        """Take the next frame; return the executor that can decide it."""
        self.has_resumed = False
        if frame.damaged:
            self.damaged.append(DamagedSpan(after_ns=self._last_ns, before_ns=frame.frame.t_ns))
        self._last_ns = frame.frame.t_ns
        if frame.memory_unknown:
            self.executor = None
        elif frame.begins_epoch or frame.frame.restarted:
            self.executor = self._executors.begin()
        elif (self.executor is None or frame.damaged) and frame.keyframe is not None:
            self.executor = self._resumed(frame.keyframe)
            self.has_resumed = self.executor is not None
        elif frame.damaged:
            self.executor = None
        if not self._executors.answered <= frame.answers.keys():
            self.executor = None
            return UnknownMemory("no answer")
        return self.executor or UnknownMemory("not observed" if frame.memory_unknown else "forgotten")

    def end(self, *, damaged: bool) -> None:
        """If `damaged`, record that the recording is damaged after its last frame."""
        if damaged:
            self.damaged.append(DamagedSpan(after_ns=self._last_ns, before_ns=None))

    def _resumed(self, keyframe: Keyframe) -> E | None:
        """Return an executor with the recorded memory, if it is known and belongs to this program."""
        if keyframe.memory is None or (keyframe.degraded and not self._trusts_degraded):
            return None
        try:
            return self._executors.resume(keyframe.memory)
        except ValueError:
            return None


def step_given(interpreter: Interpreter, frame: RunFrame, lost: frozenset[str] = frozenset()) -> Outcome:
    """Step an interpreter over a frame in which actuators were given what the verdicts say.

    Returns:
        The outcome; its decisions are those of the network, whatever the actuators were given.
    """
    actuators = {a.name: a for a in interpreter.program.robot.actuators}
    given = given_in_frame(actuators.values(), frame.verdicts)
    outcome = interpreter.step(frame.frame, lost, frame.answers, given)
    decisions = (
        interpreter.network_decision(actuators[d.actuator]) if d.actuator in given else d
        for d in outcome.decisions
    )
    return outcome._replace(decisions=tuple(decisions))
