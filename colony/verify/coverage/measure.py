"""Coverage: which obligations are covered, which never can be, and runs that would cover the others.

The prover is asked whether a goal that was not seen is never true while assumptions hold. A proof leaves the
obligation out of what can be covered; a refutation is a run of the reference interpreter that shows the goal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Set
from dataclasses import replace
from typing import Literal, NamedTuple

from colony.ir.expression import Expression, Function, FunctionCall, SensorValue, Within
from colony.ir.program import Program, Sensor
from colony.ir.types import BOOL, Array, Value, element_type, in_shape_of
from colony.verify.claims import FALSE, TRUE, all_of, constant, implies, value_or
from colony.verify.contracts.concrete_runs import LongRuns, Replay
from colony.verify.contracts.prove import ContractProver
from colony.verify.contracts.results import RESOURCES_PER_SECOND, ProofOptions, Proved, Refuted, Result, Trace
from colony.verify.contracts.slicing import slice_of
from colony.verify.coverage.obligations import (
    KINDS,
    CoverageGoal,
    CoveragePlan,
    Kind,
    Obligation,
    plan_of,
)
from colony.verify.coverage.recorder import Recorder
from colony.verify.coverage.search import found_near_tests
from colony.verify.lints.proof import Effort, LintProver, Question, asked, with_claims

_QUICK = ProofOptions(depth=1, max_frames=4, resources=RESOURCES_PER_SECOND // 4)
_FULL = ProofOptions(depth=2, max_frames=12, resources=2 * RESOURCES_PER_SECOND)
"""The effort for each goal and way to ask: before runs near the tests are tried, and after."""

_MODERATE = 1e6
"""The largest reading of a run to a goal, in the unit of its sensor, if there is such a run."""

State = Literal["covered", "uncovered", "unknown", "impossible"]
"""`unknown` is uncovered, and neither a run nor a proof decides whether it can be covered."""


class Measured(NamedTuple):
    """An obligation with its state; `unseen` are the goals of the way that lacks fewest, `runs` show them.

    One is impossible while the assumptions `assuming` hold.
    """

    obligation: Obligation
    state: State
    unseen: tuple[CoverageGoal, ...] = ()
    runs: tuple[Trace, ...] = ()
    assuming: tuple[str, ...] = ()


class ProvedNever(NamedTuple):
    """The answer that no run reaches a goal in which the assumptions `assuming` hold."""

    assuming: tuple[str, ...]


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
    def possible(self) -> int:
        """The number of obligations that are not proved impossible."""
        return len(self.measured) - self.counts()["impossible"]

    def of(self, declared: Collection[str]) -> Coverage:
        """Return the coverage of what belongs to some declarations."""
        return self._replace(measured=tuple(m for m in self.measured if m.obligation.of in declared))

    @property
    def percent(self) -> float:
        """The covered share of what is not proved impossible, in percent; 100 of nothing."""
        return 100.0 if not self.possible else 100.0 * self.counts()["covered"] / self.possible

    def kinds(self) -> tuple[Kind, ...]:
        """Return the kinds of which there are obligations."""
        return tuple(k for k in KINDS if any(m.obligation.kind == k for m in self.measured))


class GoalProver:
    """Decides whether goals can be reached. Stateful: remembers answers."""

    def __init__(self, plan: CoveragePlan) -> None:
        self._plan = plan
        self._answers: dict[str, Trace | ProvedNever | None] = {}
        self._quick = LintProver(plan.watching, Effort(), {}, {}, _QUICK)

    def answer(self, goal: CoverageGoal) -> Trace | ProvedNever | None:
        """Return a run whose last frame reaches a goal, `ProvedNever`, or None if neither is known."""
        if goal.name not in self._answers:
            self._answers[goal.name] = self._answer(goal)
        return self._answers[goal.name]

    def search(self, goals: Mapping[str, CoverageGoal]) -> None:
        """Look for runs near tests to those of these goals that are unknown, and ask about the rest again."""
        unknown = {name: goal for name, goal in goals.items() if self.answer(goal) is None}
        known = [answer for answer in self._answers.values() if isinstance(answer, Trace)]
        self._answers |= dict(found_near_tests(self._plan, unknown.values(), known))
        left = {name: goal for name, goal in unknown.items() if self._answers[name] is None}
        claims = {name: self._plan.claim(goal, self._plan.assumed) for name, goal in left.items()}
        long_runs = LongRuns(with_claims(self._plan.watching, claims))
        for name, goal in left.items():
            result = self._proof(goal, self._plan.assumed, long_runs)
            if isinstance(result, Refuted):
                self._answers[name] = self._as_test(goal, result.trace)
            elif isinstance(result, Proved):
                self._answers[name] = self._never(
                    lambda names, g=goal: isinstance(self._proof(g, names, long_runs), Proved)  # type: ignore[misc]
                )

    def _answer(self, goal: CoverageGoal) -> Trace | ProvedNever | None:
        assumed = self._plan.assumed
        trace = self._quick.refuted(self._question(goal, assumed))
        if trace is not None:
            return self._as_test(goal, trace)
        found = self._never(lambda names: bool(self._quick.proved([self._question(goal, names)])))
        is_proved = found.assuming != assumed or self._quick.proved([self._question(goal, assumed)])
        return found if is_proved else None

    def _as_test(self, goal: CoverageGoal, trace: Trace) -> Trace:
        """Return a run that a test can write and pass in the place of one that it cannot, if one is found.

        No test has infinite readings, or breaks contracts.
        """
        program = self._plan.program
        broken, infinite = _broken(program, trace), _infinite(program, trace)
        if not broken and not infinite:
            return trace
        demanded = [value_or(c.expression, FALSE) for c in program.contracts if c.name in broken]
        demanded += [_is_moderate(sensor) for sensor in infinite]
        claim = implies(all_of(demanded), self._plan.claim(goal, self._plan.assumed))
        name = " ".join((goal.name, "with", *broken, *(s.name for s in infinite)))
        other = self._quick.refuted(asked(name, claim))
        if other is None or _broken(program, other) or _infinite(program, other):
            return trace
        return other

    def _never(self, is_proved: Callable[[tuple[str, ...]], bool]) -> ProvedNever:
        """Return `ProvedNever` with few of the assumptions: none, one, or as many as cannot be left out."""
        needed = self._plan.assumed
        few = ((), *((name,) for name in needed)) if needed else ()
        found = next((names for names in few if names != needed and is_proved(names)), None)
        for name in needed if found is None and len(needed) > 2 else ():
            fewer = tuple(a for a in needed if a != name)
            needed = fewer if is_proved(fewer) else needed
        return ProvedNever(needed if found is None else found)

    def _proof(self, goal: CoverageGoal, assuming: Collection[str], long_runs: LongRuns) -> Result:
        """Return what the prover of contracts finds about a goal: with more effort, and also for floats."""
        program = with_claims(self._plan.watching, {goal.name: self._plan.claim(goal, assuming)})
        claim = replace(program.contracts[0], in_time=True)
        program = replace(program, contracts=(claim,))
        sliced = slice_of(program, claim)
        return ContractProver(program, _FULL, long_runs=long_runs, encoded=sliced).prove_disturbed(claim)

    def _question(self, goal: CoverageGoal, assuming: Collection[str]) -> Question:
        return asked(" ".join((goal.name, *assuming)), self._plan.claim(goal, assuming))


def _broken(program: Program, trace: Trace) -> tuple[str, ...]:
    """Return the contracts that a run breaks."""
    outcomes = (outcome for outcome, _ in Replay(program, None).frames(trace.snapshots))
    return tuple(dict.fromkeys(name for outcome in outcomes for name in outcome.breaches))


def _infinite(program: Program, trace: Trace) -> list[Sensor]:
    """Return the sensors with infinite readings in a run."""

    def is_infinite(x: Value | None) -> bool:
        return any(math.isinf(e) for e in (x if isinstance(x, tuple) else (x or 0.0,)))

    names = {n for s in trace.snapshots for n, x in s.readings.items() if is_infinite(x)}
    return [s for s in program.robot.sensors if s.name in names]


def _is_moderate(sensor: Sensor) -> Expression:
    """Return the condition that the readings of a sensor are missing or not extremely large."""
    most = constant(_MODERATE * sensor.factor, element_type(sensor.type))
    least = constant(-_MODERATE * sensor.factor, element_type(sensor.type))
    value = SensorValue(type=sensor.type, name=sensor.name)
    within = Within(type=in_shape_of(BOOL, sensor.type), operand=value, low=least, high=most)
    whole = (
        within
        if not isinstance(sensor.type, Array)
        else FunctionCall(type=BOOL, function=Function.ALL, arguments=(within,))
    )
    return value_or(whole, TRUE)


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
    ways = [way for m in measured if m.state == "unknown" for way in m.obligation.ways]
    prover.search({goal.name: goal for way in ways for goal in way if goal.name not in seen})
    decided = (_measured(m.obligation, seen, prover) if m.state == "unknown" else m for m in measured)
    return Coverage(plan, frames, tuple(decided))


def coverage_by_tests(program: Program, on_progress: Callable[[int, int, str], None]) -> Coverage:
    """Return the coverage of a program by its tests.

    Raises:
        DiagnosticError: a module in Python cannot be imported and built.
    """
    plan = plan_of(program)
    recorder = Recorder(plan)
    recorder.run_tests(program.tests)

    def on_obligation(number: int, subject: str) -> None:
        on_progress(number, len(plan.obligations), subject)

    return measure(plan, recorder.seen, recorder.frames, GoalProver(plan), on_obligation)


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
    never: list[list[ProvedNever]] = []
    for way in lacking:
        answers = [prover.answer(goal) for goal in way]
        runs = tuple(a for a in answers if isinstance(a, Trace))
        if len(runs) == len(way):
            return Measured(obligation, "uncovered", way, runs)
        never.append([a for a in answers if isinstance(a, ProvedNever)])
    if all(never):
        least = (min((a.assuming for a in answers), key=len) for answers in never)
        assuming = {name for names in least for name in names}
        asked_for = ((goal, prover.answer(goal)) for goal in lacking[0])
        goals = tuple(
            g for g, a in asked_for if isinstance(a, ProvedNever) and assuming.issuperset(a.assuming)
        )
        return Measured(obligation, "impossible", goals, assuming=tuple(sorted(assuming)))
    return Measured(obligation, "unknown", lacking[never.index([])])


def in_text_order(measured: Iterable[Measured]) -> Sequence[Measured]:
    """Return obligations by file and place."""
    return sorted(measured, key=lambda m: (m.obligation.span.source.name, m.obligation.span.start))
