"""The monitor: it steps the whole client list over the frames that the clients saw.

That gives the contracts broken in each frame, what was limited, clamped and faulty, and a check of the
runtime itself: while nobody is late or lost, the verdicts are the decisions of the client list; while
somebody is, they are these or idle. Where a client outside the network commanded, or a hold kept the network
from deciding, the client that was put aside is the one that would have won.

Modules in Python run in processes of their own and nowhere else: the monitor takes their answers as they
were told. From a frame in which one of them did not tell its answer, memory is not known.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple, Protocol

from colony.ir.frame import Answer, Decision, Frame, Outcome
from colony.ir.memory import ProgramMemory
from colony.runtime.protocol.messages import UNHEARD, Fate, Verdict

_NO_ANSWERS: Mapping[str, Answer] = {}


class Checked(NamedTuple):
    """What should have come of a frame, and how the verdicts differ from it without an excuse."""

    expected: Outcome
    disagreements: tuple[str, ...]


class Restartable(Protocol):
    """An executor that can go on from its initial memory, and tells what it remembers. It is given what
    modules in Python answered.
    """

    def step(self, frame: Frame, answers: Mapping[str, Answer]) -> Outcome: ...

    @property
    def memory(self) -> ProgramMemory | None: ...

    def restart(self) -> None: ...


class Keyframe(NamedTuple):
    """The memory before a frame, None where it is not known, and whether a client has been lost since it was
    initial: then what `on_loss degrade` makes of it is not known.
    """

    memory: ProgramMemory | None
    degraded: bool = False


class Monitor:
    """Mutable: the executor's memory.

    `degrading` are the actuators with `on_loss degrade`: from a frame in which any client is lost, lesser
    ones may command, which is not compared any more until memory begins anew. `modules` are those in Python.
    """

    def __init__(
        self, executor: Restartable, degrading: Iterable[str] = (), modules: Iterable[str] = ()
    ) -> None:
        self._executor = executor
        self._modules = frozenset(modules)
        self._degrading = frozenset(degrading)
        self._degraded: set[str] = set()
        self._fresh, self._memory_unknown = True, False

    def restart(self) -> None:
        """All memory begins anew with the next frame."""
        if not self._fresh:
            self._executor.restart()
        self._degraded.clear()
        self._fresh, self._memory_unknown = True, False

    def lose_memory(self) -> None:
        """Stop expecting anything until memory begins anew: a frame was missed."""
        self._memory_unknown = True

    def keyframe(self) -> Keyframe:
        """Return the memory before the next frame."""
        return Keyframe(None if self._memory_unknown else self._executor.memory, bool(self._degraded))

    def check(
        self,
        frame: Frame,
        verdicts: Mapping[str, Verdict],
        lost: Collection[str] = (),
        answers: Mapping[str, Answer] = _NO_ANSWERS,
    ) -> Checked:
        """Step, and compare, in a frame in which these clients are lost; an actuator without a verdict is not
        compared.
        """
        if not self._modules <= answers.keys():
            self._memory_unknown = True
        if self._memory_unknown:
            return Checked(Outcome(()), ())
        self._fresh = False
        if lost:
            self._degraded.update(self._degrading)
        expected = self._executor.step(frame, answers)
        found = (
            self._disagreement(decision, verdict)
            for decision in expected.decisions
            if (verdict := verdicts.get(decision.actuator)) is not None
        )
        return Checked(expected, tuple(text for text in found if text is not None))

    def _disagreement(self, decision: Decision, verdict: Verdict) -> str | None:
        same = (verdict.by, verdict.values, verdict.fault) == (decision.by, decision.values, decision.fault)
        if same and not verdict.violation:
            return None
        if not verdict.violation and (decision.actuator in self._degraded or _excused(decision, verdict)):
            return None
        got = f"{verdict.by or 'nobody'} {verdict.values}"
        due = f"{decision.by or 'nobody'} {decision.values}"
        what = "two clients were active: " if verdict.violation else ""
        return f"{decision.actuator}: {what}{got} was sent, by the client list it is {due}"


_PUT_ASIDE: frozenset[Fate] = frozenset({"overridden", "locked out", "stopped"})


def _any(verdict: Verdict, fates: frozenset[Fate]) -> bool:
    return any(fate in fates for _, fate in verdict.fates)


def _excused(decision: Decision, verdict: Verdict) -> bool:
    """Whether nobody of the network commanded, for a reason that the verdict gives."""
    if verdict.by is not None:
        return False
    if verdict.outside is None and verdict.hold is None:
        return _any(verdict, UNHEARD)
    aside = {client for client, fate in verdict.fates if fate in _PUT_ASIDE}
    return aside <= {decision.by}
