"""A search for runs to goals that neither a run nor a proof of z3 decided: known runs, varied.

What needs a long history lies near what tests do, and what runs to other goals do. So runs begin as one of
these, or as a run that showed something new, and go on with a few readings changed (compare
`testing.guided`), half of them those that a goal reads. Runs in which more parts of a goal are true are
varied more often. At last the readings of a run to each task of a sequence are held for as long as it may
take. Runs are computed in generated Python, and one to a goal is believed if the reference interpreter gets
there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from random import Random

from colony.ir import expression as ir
from colony.ir.expression import Expression
from colony.ir.frame import Frame
from colony.ir.program import Let, Machine, Module, Program, Sensor, is_regular
from colony.ir.types import Bool, Value
from colony.verify.claims import FALSE, negation, value_or
from colony.verify.contracts.concrete_runs import GeneratedRuns, Replay
from colony.verify.contracts.refute import minimize
from colony.verify.contracts.results import Trace
from colony.verify.coverage.decisions import is_composed
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

_FRAMES = 60_000
"""Number of frames that are computed for all goals of a program."""

_PATIENCE = 300
"""Number of frames that the interpreter computes to minimize a run, at most."""

_MAX_LENGTH = 300
"""Maximum length of a run that is varied."""

_MAX_HELD = 15_000
"""Maximum number of frames for which the readings of a run are held, until the time of a task is over."""

_BEST = 6
"""Number of runs that are kept for each goal, of those that come nearest to it."""


def found_near_tests(
    plan: CoveragePlan, goals: Iterable[CoverageGoal], known: Iterable[Trace] = ()
) -> Iterator[tuple[str, Trace]]:
    """Yield the names of goals to which a run was found, each with it; `known` are runs to other goals."""
    wanted = {goal.name: goal for goal in goals}
    starts = [snapshots_of(plan.program, test) for test in plan.program.tests]
    starts += [trace.snapshots for trace in known]
    if not wanted or not any(starts) or has_python_modules(plan.program):
        return
    claims = {name: plan.claim(goal, plan.assumed) for name, goal in plan.goals.items()}
    nearness = _Nearness(plan, wanted.values())
    runs = GeneratedRuns(with_claims(plan.watching, {**claims, **nearness.claims}))
    variants = _Variants(plan, wanted, starts)

    def reached(trace: Sequence[Snapshot], shown: Set[str]) -> Iterator[tuple[str, Trace]]:
        for name in sorted(shown & wanted.keys()):
            replay = Replay(with_claims(plan.watching, {name: claims[name]}), name)
            outcomes, breach = replay.outcomes_and_breach(trace)
            if breach is not None:
                del wanted[name]
                is_long = breach >= _MAX_LENGTH  # held readings, which the interpreter takes seconds to run
                whole = Trace(snapshots=tuple(trace[: breach + 1]), outcomes=outcomes)
                yield name, whole if is_long else minimize(replay, trace, _PATIENCE)

    frames, seen = 0, set[frozenset[str]]()
    while frames < _FRAMES and wanted:
        trace = variants.draw(tuple(wanted))
        for i, outcome in enumerate(runs.outcomes(trace)):
            frames += 1
            shown = frozenset(outcome.breaches)
            if shown not in seen:
                seen.add(shown)
                variants.keep(trace[: i + 1], nearness.scores(shown), shown)
            yield from reached(trace[: i + 1], shown)
    for trace in variants.held(plan) if wanted else ():
        for i, outcome in enumerate(runs.outcomes(trace)):
            shown = frozenset(outcome.breaches)
            if not wanted.keys().isdisjoint(shown):
                yield from reached(trace[: i + 1], shown)


class _Nearness:
    """How near a frame is to goals: the share of the parts of a conjunction that are true in it."""

    def __init__(self, plan: CoveragePlan, goals: Iterable[CoverageGoal]) -> None:
        lets = {d.name: d.expression for d in plan.watching.derived if isinstance(d, Let)}
        self._parts: dict[str, list[str]] = {}
        self.claims: dict[str, Expression] = {}
        for goal in goals:
            parts = list(_parts(goal.condition, lets))
            if not any(isinstance(x, ir.MemoryCall) for part in parts for x in ir.subexpressions(part)):
                names = [f"part {i} of {goal.name}" for i in range(len(parts))]
                self._parts[goal.name] = names
                shown = (negation(value_or(part, FALSE)) for part in parts)
                self.claims |= dict(zip(names, shown, strict=True))

    def scores(self, shown: Set[str]) -> dict[str, float]:
        """Return, by goal, how near a frame is that shows goals and parts."""
        return {goal: sum(p in shown for p in parts) / len(parts) for goal, parts in self._parts.items()}


def _parts(e: Expression, lets: Mapping[str, Expression]) -> Iterator[Expression]:
    """Yield the operands of a conjunction, and of those that its operands name."""
    match e:
        case ir.ValueOr(expression=expression) if isinstance(e.type, Bool):
            yield from _parts(expression, lets)
        case ir.BinaryOperation(operator=ir.Binary.AND, left=left, right=right):
            yield from _parts(left, lets)
            yield from _parts(right, lets)
        case ir.DerivedValue(name=name) if is_composed(lets[name]):
            yield from _parts(lets[name], lets)
        case _:
            yield e


class _Variants:
    """Draws variants of the runs that are kept. Stateful: begins with the runs `starts`."""

    def __init__(
        self, plan: CoveragePlan, goals: Mapping[str, CoverageGoal], starts: Iterable[tuple[Snapshot, ...]]
    ) -> None:
        self._program = plan.program
        self._choices = Choices(Random(0))
        self._kept = [start[:_MAX_LENGTH] for start in starts if start]
        self._pending = list(self._kept)
        self._first: dict[str, tuple[Snapshot, ...]] = {}
        self._best: dict[str, tuple[float, list[tuple[Snapshot, ...]]]] = {}
        read = sensors_read(plan.program)
        self._sensors = [s for s in plan.program.robot.sensors if s.name in read]
        focus = {name: _sensors_behind(plan.watching, goal.condition) for name, goal in goals.items()}
        self._focus = {n: [s for s in self._sensors if s.name in names] for n, names in focus.items()}
        self._thresholds = thresholds_of(plan.program)
        self._gaps = gaps_of(plan.program)

    def keep(self, trace: tuple[Snapshot, ...], scores: Mapping[str, float], shown: Set[str]) -> None:
        """Let later runs begin as this one, which shows goals, more often those to goals that are near."""
        for name in shown:
            self._first.setdefault(name, trace)
        if len(trace) >= _MAX_LENGTH:
            return
        self._kept.append(trace)
        for goal, score in scores.items():
            best, traces = self._best.get(goal, (0.0, []))
            if score > best:
                self._best[goal] = score, [trace]
            elif score == best > 0:
                self._best[goal] = score, [*traces[1 - _BEST :], trace]

    def draw(self, wanted: Sequence[str]) -> tuple[Snapshot, ...]:
        """Return each run of the start once, then kept runs that are changed from some frame on."""
        if self._pending:
            return self._pending.pop()
        c = self._choices
        goal = c.pick(wanted)
        _, near = self._best.get(goal, (0.0, []))
        is_near = bool(near) and c.one_in(2)
        if is_near:
            base = c.pick(near)
        else:
            base = self._kept[c.mostly_large(0, len(self._kept) - 1)] if c.one_in(2) else c.pick(self._kept)
        sensors = self._focus[goal] if self._focus[goal] and c.one_in(2) else self._sensors
        at = len(base) - 1 if is_near and c.one_in(2) else c.between(0, len(base) - 1)
        changed = self._changes(base[at], sensors)
        if c.one_in(2):
            return (*base[:at], *(self._with(s, changed) for s in base[at:]))
        trace = base[: at + 1]
        for _ in range(c.between(1, 3)):
            last = trace[-1]
            later = last._replace(t_ns=last.t_ns + c.pick(self._gaps), restarted=False)
            trace += (self._with(later, self._changes(last, sensors)),)
        return trace if is_regular(self._program.robot, (s.t_ns for s in trace)) else base

    def held(self, plan: CoveragePlan) -> Iterator[tuple[Snapshot, ...]]:
        """Yield, for each task of a sequence, a run to it of which the last readings are held."""
        period = self._program.robot.frame_ns
        for machine in self._program.derived:
            for phase in machine.tasks if isinstance(machine, Machine) else ():
                ends = [
                    e
                    for o in plan.obligations
                    if (o.subject, o.text) == (machine.name, phase)
                    for e in o.ways
                ]
                trace = next((self._first.get(goal.name) for way in ends for goal in way), None)
                if trace is not None:
                    last = trace[-1]
                    later = (last._replace(t_ns=last.t_ns + i * period) for i in range(1, _MAX_HELD))
                    yield (*trace, *later)

    def _with(self, frame: Snapshot, changed: dict[str, Value | None]) -> Snapshot:
        readings = present_readings(self._program, {**frame.readings, **changed})
        return frame._replace(readings=readings)

    def _changes(self, frame: Snapshot, sensors: Sequence[Sensor]) -> dict[str, Value | None]:
        """Return new readings of one to three sensors, in base units."""
        c = self._choices
        drawn = {}
        for _ in range(c.between(1, 3)):
            sensor = c.pick(sensors)
            drawn[sensor.name] = draw_reading(c, sensor, self._thresholds)
        found = snapshot_of(self._program, Frame(frame.t_ns, drawn)).readings
        return {name: found.get(name) for name in drawn}


def _sensors_behind(program: Program, e: Expression) -> frozenset[str]:
    """Return the sensors that an expression reads, also by lets."""
    lets = {d.name: d.expression for d in program.derived if isinstance(d, Let)}
    lets |= {x.name: x.expression for m in program.modules if isinstance(m, Module) for x in m.lets}
    found, pending, visited = set[str](), [e], set[str]()
    while pending:
        for x in ir.subexpressions(pending.pop()):
            if (
                isinstance(x, ir.SensorValue | ir.Fresh | ir.DerivedValue | ir.LocalValue)
                and x.name not in visited
            ):
                visited.add(x.name)
                found.update(() if x.name in lets else (x.name,))
                pending += [lets[x.name]] if x.name in lets else []
    return frozenset(found)
