"""A search for runs to goals that neither a run nor a proof of z3 decided: the tests of a program, varied.

What needs a long history lies near what tests do. So runs begin as a test, or as a run that showed something
new, and go on with a few readings changed (compare `testing.guided`). They are computed in generated Python,
and a run to a goal is believed if the reference interpreter gets there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from random import Random

from colony.ir.frame import Frame
from colony.ir.program import is_regular
from colony.ir.types import Value
from colony.verify.contracts.concrete_runs import GeneratedRuns, Replay
from colony.verify.contracts.refute import minimize
from colony.verify.contracts.results import Trace
from colony.verify.coverage.obligations import CoverageGoal, CoveragePlan
from colony.verify.lints.proof import has_python_modules, with_claims
from colony.verify.snapshot import Snapshot, present_readings, snapshot_of
from colony.verify.testing.frames import (
    Choices,
    draw_reading,
    gaps_of,
    sensors_read,
    snapshots_of,
    thresholds_of,
)

_FRAMES = 20_000
"""Number of frames that are computed for all goals of a program."""

_PATIENCE = 300
"""Number of frames that the interpreter computes to minimize a run, at most."""

_MAX_LENGTH = 300
"""Maximum length of a run."""


def found_near_tests(plan: CoveragePlan, goals: Iterable[CoverageGoal]) -> Iterator[tuple[str, Trace]]:
    """Yield the names of goals to which a run was found, each with its run."""
    wanted = {goal.name: goal for goal in goals}
    if not wanted or not plan.program.tests or has_python_modules(plan.program):
        return
    claims = {name: plan.claim(goal, plan.assumed) for name, goal in plan.goals.items()}
    runs, variants = GeneratedRuns(with_claims(plan.watching, claims)), _Variants(plan)
    frames, seen = 0, set[frozenset[str]]()
    while frames < _FRAMES and wanted:
        trace = variants.draw()
        for i, outcome in enumerate(runs.outcomes(trace)):
            frames += 1
            shown = frozenset(outcome.breaches)
            if shown not in seen:
                seen.add(shown)
                variants.keep(trace[: i + 1])
            for name in shown & wanted.keys():
                replay = Replay(with_claims(plan.watching, {name: claims[name]}), name)
                if replay.breaks(trace[: i + 1]):
                    del wanted[name]
                    yield name, minimize(replay, trace[: i + 1], _PATIENCE)


class _Variants:
    """Draws variants of the runs that are kept. Stateful: begins with the tests of the program."""

    def __init__(self, plan: CoveragePlan) -> None:
        self._program = plan.program
        self._choices = Choices(Random(0))
        tests = (snapshots_of(plan.program, test) for test in plan.program.tests)
        self._kept = [test[:_MAX_LENGTH] for test in tests if test]
        self._pending = list(self._kept)
        read = sensors_read(plan.program)
        self._sensors = [s for s in plan.program.robot.sensors if s.name in read]
        self._thresholds = thresholds_of(plan.program)
        self._gaps = gaps_of(plan.program)

    def keep(self, trace: tuple[Snapshot, ...]) -> None:
        """Let later runs begin as this one."""
        if len(trace) < _MAX_LENGTH:
            self._kept.append(trace)

    def draw(self) -> tuple[Snapshot, ...]:
        """Return each test once, then kept runs that are changed from some frame on."""
        if self._pending:
            return self._pending.pop()
        c = self._choices
        base = self._kept[c.mostly_large(0, len(self._kept) - 1)] if c.one_in(2) else c.pick(self._kept)
        at = c.between(0, len(base) - 1)
        changed = self._changes(base[at])
        if c.one_in(2):
            return (*base[:at], *(self._with(s, changed) for s in base[at:]))
        trace = base[: at + 1]
        for _ in range(c.between(1, 3)):
            last = trace[-1]
            later = last._replace(t_ns=last.t_ns + c.pick(self._gaps), restarted=False)
            trace += (self._with(later, self._changes(last)),)
        return trace if is_regular(self._program.robot, (s.t_ns for s in trace)) else base

    def _with(self, frame: Snapshot, changed: dict[str, Value | None]) -> Snapshot:
        readings = present_readings(self._program, {**frame.readings, **changed})
        return frame._replace(readings=readings)

    def _changes(self, frame: Snapshot) -> dict[str, Value | None]:
        """Return new readings of one to three sensors, in base units."""
        c = self._choices
        drawn = {}
        for _ in range(c.between(1, 3)):
            sensor = c.pick(self._sensors)
            drawn[sensor.name] = draw_reading(c, sensor, self._thresholds)
        found = snapshot_of(self._program, Frame(frame.t_ns, drawn)).readings
        return {name: found.get(name) for name in drawn}
