"""The monitor, which steps the whole client list over the frames that the clients saw.

This yields the contracts broken in each frame, the limited, clamped and faulty commands, and a check of the
runtime itself: while no client is late or lost, the verdicts must be the decisions of the client list;
otherwise a verdict may also be idle. Where a connection outside the network commanded, or a hold kept the
network from deciding, the client that did not get through must be the one that would have won.

Contracts are evaluated of what was sent: of the command from outside, or of the idle command if the actuator
was idle because of a hold, or because a client was late or lost.

Modules in Python run only in their own processes: the monitor takes the answers that they announced. After a
frame in which one of them announced no answer, memory is unknown as long as it depends on that answer.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple, Protocol

from colony.ir.frame import NOTHING_GIVEN, Answer, Decision, Frame, Given, Outcome
from colony.ir.given import given_in_frame, is_connection
from colony.ir.memory import ProgramMemory
from colony.ir.program import Actuator
from colony.runtime.frames.run_frame import Keyframe
from colony.runtime.protocol.messages import UNHEARD, Fate, Verdict

_NO_ANSWERS: Mapping[str, Answer] = {}


class CheckedFrame(NamedTuple):
    """The expected outcome of a frame, and the unexcused differences of the verdicts from it."""

    expected: Outcome
    disagreements: tuple[str, ...]


class RestartableExecutor(Protocol):
    """An executor that can restart from its initial memory, and exposes its memory."""

    def step(
        self, frame: Frame, answers: Mapping[str, Answer], given: Mapping[str, Given] = NOTHING_GIVEN
    ) -> Outcome:
        """Return the outcome of a frame, given the answers of modules in Python.

        `given` is what actuators were given, where that may not be what the network decided.
        """
        ...

    def advance(self, frame: Frame, answers: Mapping[str, Answer], missing: Collection[str]) -> bool:
        """Step over a frame with missing answers, or one after it; return True if memory is known."""
        ...

    def network_decisions(self) -> tuple[Decision, ...]:
        """Return what the network decided in the last frame, whatever actuators were given."""
        ...

    @property
    def memory(self) -> ProgramMemory | None:
        """The current memory, None if it is unknown."""
        ...

    def restart(self) -> None:
        """Reset all memory to its initial values."""
        ...


class Monitor:
    """Checks verdicts against the client list. Mutable.

    `degrading_actuators` are those with `on_loss degrade`. Once any client is lost, lesser clients may
    command them, so their verdicts are not compared until memory restarts. `modules` are the modules in
    Python. `actuators` are those of which contracts see what was sent, and not what the network decided.
    """

    def __init__(
        self,
        executor: RestartableExecutor,
        degrading_actuators: Iterable[str] = (),
        modules: Iterable[str] = (),
        actuators: Iterable[Actuator] = (),
    ) -> None:
        self._actuators = tuple(actuators)
        self._executor = executor
        self._modules = frozenset(modules)
        self._degrading_actuators = frozenset(degrading_actuators)
        self._degraded: set[str] = set()
        self._memory_is_initial, self._memory_unknown, self._is_doubted = True, False, False

    def restart(self) -> None:
        """Restart all memory with the next frame."""
        if not self._memory_is_initial:
            self._executor.restart()
        self._degraded.clear()
        self._memory_is_initial, self._memory_unknown, self._is_doubted = True, False, False

    def lose_memory(self) -> None:
        """Stop comparing until memory restarts, because a frame was missed."""
        self._memory_unknown = True

    def keyframe(self) -> Keyframe:
        """Return the memory before the next frame."""
        is_known = not (self._memory_unknown or self._is_doubted)
        return Keyframe(self._executor.memory if is_known else None, bool(self._degraded))

    def check(
        self,
        frame: Frame,
        verdicts: Mapping[str, Verdict],
        lost: Collection[str] = (),
        answers: Mapping[str, Answer] = _NO_ANSWERS,
    ) -> CheckedFrame:
        """Step over a frame in which the clients `lost` are lost, and compare the received verdicts."""
        if self._memory_unknown:
            return CheckedFrame(Outcome(()), ())
        self._memory_is_initial = False
        if lost:
            self._degraded.update(self._degrading_actuators)
        missing = self._modules - answers.keys()
        if missing or self._is_doubted:
            self._is_doubted = not self._executor.advance(frame, answers, missing)
            return CheckedFrame(Outcome(()), ())
        given = given_in_frame(self._actuators, verdicts)
        if given:
            outcome = self._executor.step(frame, answers, given)
            expected = outcome._replace(decisions=self._executor.network_decisions())
        else:
            expected = self._executor.step(frame, answers)
        texts = (
            self._disagreement(decision, verdict)
            for decision in expected.decisions
            if (verdict := verdicts.get(decision.actuator)) is not None
        )
        return CheckedFrame(expected, tuple(text for text in texts if text is not None))

    def _disagreement(self, decision: Decision, verdict: Verdict) -> str | None:
        same = (verdict.by, verdict.values, verdict.fault) == (decision.by, decision.values, decision.fault)
        if same and not verdict.violation:
            return None
        if not verdict.violation and (decision.actuator in self._degraded or _is_excused(decision, verdict)):
            return None
        sent = f"{verdict.by or 'nobody'} {verdict.values}"
        expected = f"{decision.by or 'nobody'} {decision.values}"
        violation = "two clients were active: " if verdict.violation else ""
        return f"{decision.actuator}: {violation}{sent} was sent; the client list gives {expected}"


_EXCLUDED_FATES: frozenset[Fate] = frozenset({"overridden", "locked out", "stopped"})


def _has_fate(verdict: Verdict, fates: frozenset[Fate]) -> bool:
    return any(fate in fates for _, fate in verdict.fates)


def _is_excused(decision: Decision, verdict: Verdict) -> bool:
    """Return True if the verdict gives a reason why no client of the network commanded."""
    if verdict.by is not None:
        return False
    if verdict.outside is None and verdict.hold is None:
        return _has_fate(verdict, UNHEARD)
    excluded = {
        party for party, fate in verdict.fates if fate in _EXCLUDED_FATES and not is_connection(party)
    }
    return excluded <= {decision.by}
