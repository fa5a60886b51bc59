"""Coverage: which obligations are covered, which never can be, and runs that would cover the others.

The prover is asked whether a goal that was not seen is never true. A proof leaves the obligation out of what
can be covered; a refutation is a run of the reference interpreter that shows the goal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from typing import Literal, NamedTuple

from colony.verify.claims import negation
from colony.verify.contracts.results import RESOURCES_PER_SECOND, ProofOptions, Trace
from colony.verify.coverage.obligations import KINDS, CoverageGoal, CoveragePlan, Kind, Obligation
from colony.verify.coverage.search import found_near_tests
from colony.verify.lints.proof import Effort, LintProver, asked

_QUICK = ProofOptions(depth=1, max_frames=4, resources=RESOURCES_PER_SECOND // 4)
_FULL = ProofOptions(depth=2, max_frames=12, resources=2 * RESOURCES_PER_SECOND)
"""The effort for each goal: before runs near the tests are tried, and after."""

State = Literal["covered", "uncovered", "unknown", "impossible"]
"""`unknown` is uncovered, and neither a run nor a proof decides whether it can be covered."""


class Measured(NamedTuple):
    """An obligation with its state; `unseen` are the goals of the way that lacks fewest, `runs` show them."""

    obligation: Obligation
    state: State
    unseen: tuple[CoverageGoal, ...] = ()
    runs: tuple[Trace, ...] = ()


class Coverage(NamedTuple):
    """The coverage of a program by a number of frames."""

    plan: CoveragePlan
    frames: int
    measured: tuple[Measured, ...]

    def counts(self, kind: Kind | None = None) -> dict[State, int]:
        """Return the number of obligations in each state, of one kind or of all."""
        states: dict[State, int] = dict.fromkeys(("covered", "uncovered", "unknown", "impossible"), 0)
        for m in self.measured:
            if kind is None or m.obligation.kind == kind:
                states[m.state] += 1
        return states

    @property
    def percent(self) -> float:
        """The covered share of what is not proved impossible, in percent; 100 of nothing."""
        counts = self.counts()
        possible = len(self.measured) - counts["impossible"]
        return 100.0 if not possible else 100.0 * counts["covered"] / possible

    def kinds(self) -> tuple[Kind, ...]:
        """Return the kinds of which there are obligations."""
        return tuple(k for k in KINDS if any(m.obligation.kind == k for m in self.measured))


class GoalProver:
    """Decides whether goals can be reached. Stateful: remembers answers."""

    def __init__(self, plan: CoveragePlan) -> None:
        self._plan = plan
        self._answers: dict[str, Trace | bool] = {}
        self._quick, self._full = (
            LintProver(plan.instrumented, Effort(), {}, {}, o) for o in (_QUICK, _FULL)
        )

    def answer(self, goal: CoverageGoal) -> Trace | bool:
        """Return a run whose last frame reaches a goal, False if none does, True if that is unknown."""
        if goal.name not in self._answers:
            self._answers[goal.name] = _answer(self._quick, goal)
        return self._answers[goal.name]

    def search(self, goals: Mapping[str, CoverageGoal]) -> None:
        """Look for runs near tests to those of these goals that are unknown, and ask about the rest again."""
        unknown = {name: goal for name, goal in goals.items() if self.answer(goal) is True}
        self._answers |= dict(found_near_tests(self._plan, unknown.values()))
        for name, goal in unknown.items():
            if self._answers[name] is True:
                self._answers[name] = _answer(self._full, goal)


def _answer(prover: LintProver, goal: CoverageGoal) -> Trace | bool:
    question = asked(goal.name, negation(goal.condition))
    trace = prover.refuted(question)
    if trace is not None:
        return trace
    return prover.is_undecided(goal.name) or not prover.proved([question])


def measure(
    plan: CoveragePlan,
    seen: Set[str],
    frames: int,
    prover: GoalProver,
    on_obligation: Callable[[int, str], None] = lambda number, subject: None,
) -> Coverage:
    """Return the coverage by the goals that were `seen` in so many frames.

    `on_obligation` receives the number and the subject of each obligation before the prover decides it.
    """
    measured = []
    for number, obligation in enumerate(plan.obligations):
        on_obligation(number, obligation.subject)
        measured.append(_measured(obligation, seen, prover))
    on_obligation(len(measured), "longer runs")
    prover.search({goal.name: goal for m in measured if m.state == "unknown" for goal in m.unseen})
    decided = (_measured(m.obligation, seen, prover) if m.state == "unknown" else m for m in measured)
    return Coverage(plan, frames, tuple(decided))


def with_seen(coverage: Coverage, seen: Set[str], frames: int) -> Coverage:
    """Return the coverage if these goals were seen, in so many more frames."""
    measured = (
        Measured(m.obligation, "covered") if covered_by(m.obligation, seen) else m for m in coverage.measured
    )
    return coverage._replace(measured=tuple(measured), frames=coverage.frames + frames)


def covered_by(obligation: Obligation, seen: Set[str]) -> bool:
    """Return True if goals that were seen cover an obligation."""
    return any(all(goal.name in seen for goal in way) for way in obligation.ways)


def _measured(obligation: Obligation, seen: Set[str], prover: GoalProver) -> Measured:
    if covered_by(obligation, seen):
        return Measured(obligation, "covered")
    lacking = [tuple(goal for goal in way if goal.name not in seen) for way in obligation.ways]
    lacking.sort(key=len)
    impossible = []
    for way in lacking:
        answers = [prover.answer(goal) for goal in way]
        runs = tuple(a for a in answers if isinstance(a, Trace))
        if len(runs) == len(way):
            return Measured(obligation, "uncovered", way, runs)
        impossible.append(False in answers)
    if all(impossible):
        never = tuple(g for g in lacking[0] if prover.answer(g) is False)
        return Measured(obligation, "impossible", never)
    return Measured(obligation, "unknown", lacking[impossible.index(False)])


def in_text_order(measured: Iterable[Measured]) -> Sequence[Measured]:
    """Return obligations by file and place."""
    return sorted(measured, key=lambda m: (m.obligation.span.source.name, m.obligation.span.start))
