"""The monitor: it steps the whole client list over the frames that the clients saw.

That gives the contracts broken in each frame, what was limited, clamped and faulty, and a check of the
runtime itself: while nobody is late or lost, the verdicts are the decisions of the client list; while
somebody is, they are these or idle.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from colony.ir.frame import Decision, Executor, Frame, Outcome
from colony.runtime.messages import Verdict


class Checked(NamedTuple):
    """What should have come of a frame, and how the verdicts differ from it without an excuse."""

    expected: Outcome
    disagreements: tuple[str, ...]


class Monitor:
    """Mutable: the executor's memory."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def check(self, frame: Frame, verdicts: Mapping[str, Verdict]) -> Checked:
        """Step, and compare; an actuator without a verdict is not compared."""
        expected = self._executor.step(frame)
        found = (
            _disagreement(decision, verdict)
            for decision in expected.decisions
            if (verdict := verdicts.get(decision.actuator)) is not None
        )
        return Checked(expected, tuple(text for text in found if text is not None))


_EXCUSES = frozenset({"late", "lost", "refused"})


def _disagreement(decision: Decision, verdict: Verdict) -> str | None:
    same = (verdict.by, verdict.values, verdict.fault) == (decision.by, decision.values, decision.fault)
    if same and not verdict.violation:
        return None
    if not verdict.violation and verdict.by is None and any(f in _EXCUSES for _, f in verdict.fates):
        return None
    got = f"{verdict.by or 'nobody'} {verdict.values}"
    due = f"{decision.by or 'nobody'} {decision.values}"
    what = "two clients were active: " if verdict.violation else ""
    return f"{decision.actuator}: {what}{got} was sent, by the client list it is {due}"
