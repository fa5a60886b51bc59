"""A frame of a run, with everything that answers about it need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypedDict, Unpack

from colony.ir.frame import Answer, Frame, Outcome
from colony.ir.given import SentCommand
from colony.ir.program import Limit, Program
from colony.ir.types import ScalarValue
from colony.verify.explain.causes import Absence
from colony.verify.explain.history import NO_HISTORY, History
from colony.verify.reference.expressions import FrameValues, Memory
from colony.verify.reference.interpreter import Interpreter
from colony.verify.reference.memory import InterpreterState


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """A frame that the interpreter has decided.

    Attributes:
        program: The program.
        k: Number of the frame.
        frame: Its time and readings.
        outcome: The interpreter's decisions.
        values: The values of the frame.
        memory: What memory functions remembered before the frame.
        last_active_ns: For each node of the network, the time before the frame at which its dominant side was
            last active.
        silent: Modules that are silent because something that they read is missing.
        blind: Failsafe modules that are active without an answer.
        limits: Limits that applied, each with its bound; None if that was missing.
        absent: Missing sensors, each with the reason.
        answers: Answers of modules in Python.
        lost: Modules whose clients are lost, where others act in their place.
        late: Actuators that are idle because a client is late, in a run without verdicts.
        verdicts: The verdicts of the runtime, by actuator; none for a run of the interpreter alone.
        history: Since when things are as they are after this frame.
        earlier: Since when they were as they were before it, as states and memory functions read them.
    """

    program: Program
    k: int
    frame: Frame
    outcome: Outcome
    values: FrameValues
    memory: Memory
    last_active_ns: Mapping[tuple[str | int, ...], int]
    silent: frozenset[str]
    blind: frozenset[str]
    limits: tuple[tuple[Limit, float | None], ...]
    absent: Mapping[str, Absence]
    history: History
    earlier: History = NO_HISTORY
    answers: Mapping[str, Answer] = field(default_factory=dict)
    lost: frozenset[str] = frozenset()
    late: frozenset[str] = frozenset()
    verdicts: Mapping[str, SentCommand] = field(default_factory=dict)

    @property
    def t_ns(self) -> int:
        """The time of the frame."""
        return self.frame.t_ns

    @property
    def is_first(self) -> bool:
        """True if there is nothing to remember: memory was initial before the frame."""
        return self.values.first_ns == self.values.t_ns

    def winner(self, actuator: str) -> str | None:
        """Return the module that the actuator was commanded by, of the runtime where it is known."""
        verdict = self.verdicts.get(actuator)
        return self.outcome.commands[actuator].by if verdict is None else verdict.by

    def sent(self, actuator: str) -> tuple[ScalarValue, ...] | None:
        """Return what the actuator was sent, in declared units; None if nothing."""
        verdict = self.verdicts.get(actuator)
        return self.outcome.commands[actuator].values if verdict is None else verdict.values

    def fault(self, actuator: str) -> str | None:
        """Return why the idle command was sent in place of another, if it was."""
        verdict = self.verdicts.get(actuator)
        return self.outcome.commands[actuator].fault if verdict is None else verdict.fault


class Seen(TypedDict, total=False):
    """What is known of a frame besides the interpreter's state; see `Moment`."""

    k: int
    frame: Frame
    outcome: Outcome
    absent: Mapping[str, Absence]
    earlier: History
    answers: Mapping[str, Answer]
    verdicts: Mapping[str, SentCommand]
    lost: frozenset[str]
    late: frozenset[str]


def moment_of(
    program: Program,
    interpreter: Interpreter,
    before: InterpreterState | None,
    history: History,
    **seen: Unpack[Seen],
) -> Moment:
    """Return the moment of a frame that the interpreter has decided; `before` is its state before that."""
    names = [m.name for m in program.modules]
    return Moment(
        program=program,
        values=interpreter.values,
        memory={} if before is None else before.memory.functions,
        last_active_ns={} if before is None else before.memory.last_active_ns,
        silent=frozenset(n for n in names if interpreter.is_silent(n)),
        blind=frozenset(n for n in names if interpreter.is_blind(n)),
        limits=interpreter.limits,
        history=history,
        **seen,
    )
