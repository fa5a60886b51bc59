"""The missing tests: for each obligation that a run covers, the run as a `test` block."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence, Set
from typing import NamedTuple

from colony.dsl import ast
from colony.ir.program import Actuator, Program, without_assumed
from colony.ir.types import Value
from colony.verify.contracts.example_block import literal, test_block
from colony.verify.coverage.measure import Coverage, Measured, in_text_order
from colony.verify.coverage.obligations import CoverageGoal, CoveragePlan
from colony.verify.coverage.recorder import seen_in
from colony.verify.reference.interpreter import Interpreter
from colony.verify.snapshot import Snapshot
from colony.verify.testing.frames import snapshots_of

MARK = "# observed: accept or correct"
"""The comment above a generated test: it expects what the program does, which no person has confirmed."""


_MAX_WIDTH = 110

_MAX_LENGTH = 300
"""Length of a run that gets readings of other sensors, and of which all goals are recorded, at most."""


class GeneratedTest(NamedTuple):
    """A test that covers goals, as text with its mark."""

    title: str
    text: str
    goals: frozenset[str]
    frames: int


class Generated(NamedTuple):
    """The generated tests, and the obligations of which the run cannot be written or breaks a contract."""

    tests: tuple[GeneratedTest, ...]
    left_out: tuple[Measured, ...]


def generate(coverage: Coverage, seen: Set[str]) -> Generated:
    """Return tests that cover what is uncovered and has a run; none of them is covered by the others."""
    plan, known, left_out = coverage.plan, set(seen), []
    titles = {test.name for test in plan.program.tests}
    tests: list[GeneratedTest] = []
    for measured in in_text_order(m for m in coverage.measured if m.state == "uncovered"):
        wanted = {goal.name for goal in measured.unseen} - known
        for snapshots in _runs(plan, measured, wanted):
            title = _free(_title(measured, wanted), titles)
            text = _text(plan.program, title, snapshots)
            if text is None:
                left_out.append(measured)
                continue
            titles.add(title)
            is_shown = len(wanted) == 1 and len(snapshots) > _MAX_LENGTH  # without running it for seconds
            goals = frozenset(wanted) if is_shown else seen_in(plan, snapshots)
            tests.append(GeneratedTest(title, _marked(text), goals, len(snapshots)))
            known |= tests[-1].goals
    return Generated(tuple(_needed(tests, seen)), tuple(left_out))


def _marked(test: str) -> str:
    """Return the text of a test with its mark, and a line break before what long steps expect."""
    lines = (
        x if len(x) <= _MAX_WIDTH else x.replace(" expect ", f"\n{'':10}expect ", 1) for x in test.split("\n")
    )
    return f"{MARK}\n{chr(10).join(lines)}"


def _needed(tests: Sequence[GeneratedTest], seen: Set[str]) -> list[GeneratedTest]:
    """Return the tests without those that show only goals of the others."""
    kept = list(tests)
    for test in reversed(tests):
        others = set(seen).union(*(t.goals for t in kept if t is not test))
        if test.goals <= others:
            kept.remove(test)
    return kept


def _runs(plan: CoveragePlan, measured: Measured, wanted: Set[str]) -> Iterator[tuple[Snapshot, ...]]:
    """Yield the runs to goals that are wanted: one run if it can show them all."""
    goals = zip(measured.unseen, measured.runs, strict=True)
    runs = [_amid_others(plan, run.snapshots, goal) for goal, run in goals if goal.name in wanted]
    if len(runs) > 1:
        joined = runs[0]
        for run in runs[1:]:
            shift = joined[-1].t_ns + plan.program.robot.frame_ns - run[0].t_ns
            joined += tuple(s._replace(t_ns=s.t_ns + shift) for s in run)
        if wanted <= seen_in(plan, joined):
            runs = [joined]
    yield from runs


def _amid_others(
    plan: CoveragePlan, snapshots: tuple[Snapshot, ...], goal: CoverageGoal
) -> tuple[Snapshot, ...]:
    """Return a run to a goal in which other sensors read what they read at the beginning of a test.

    A sensor without which the goal is reached alone stays missing.
    """
    if len(snapshots) > _MAX_LENGTH:
        return snapshots
    snapshots = _finite(plan, snapshots, goal)
    given = {name for s in snapshots for name in s.readings}
    given |= {s.name for s in plan.program.robot.sensors if s.sent is not None}
    for test in plan.program.tests:
        others = {n: x for n, x in snapshots_of(plan.program, test)[0].readings.items() if n not in given}
        for group in (others, *({name: x} for name, x in others.items())):
            more = tuple(s._replace(readings={**group, **s.readings}) for s in snapshots)
            if goal.name in seen_in(plan, more):
                snapshots = more
                given |= group.keys()
            if others.keys() <= given:
                break
    return snapshots


def _finite(plan: CoveragePlan, snapshots: tuple[Snapshot, ...], goal: CoverageGoal) -> tuple[Snapshot, ...]:
    """Return a run to a goal with large readings in the place of infinite ones, if it gets there as well."""

    def large(x: Value | None, size: float) -> Value | None:
        if isinstance(x, tuple):
            return tuple(math.copysign(size, e) if math.isinf(e) else e for e in x)
        return math.copysign(size, x) if x is not None and math.isinf(x) else x

    for size in (1e3, 1e6, 1e9):
        run = tuple(
            s._replace(readings={n: large(x, size) for n, x in s.readings.items()}) for s in snapshots
        )
        if goal.name in seen_in(plan, run):
            return run
    return snapshots


def _title(measured: Measured, wanted: Set[str]) -> str:
    if len(wanted) > 1:
        return f"covers: `{measured.obligation.text}` decides `{measured.obligation.subject}`"
    return f"covers: {next(g.text for g in measured.unseen if g.name in wanted)}"


def _free(title: str, titles: Set[str]) -> str:
    """Return a title that no test has."""
    title, number = title.replace('"', "'"), 1
    while (f"{title} ({number})" if number > 1 else title) in titles:
        number += 1
    return f"{title} ({number})" if number > 1 else title


def _text(program: Program, title: str, snapshots: Sequence[Snapshot]) -> str | None:
    """Return a run as a test that expects what the interpreter decides; None if it cannot pass."""
    interpreter = Interpreter(without_assumed(program))
    wired = {w.actuator for w in program.wires}
    actuators = [a for a in program.robot.actuators if a.name in wired]
    expected = []
    for s in snapshots:
        outcome = interpreter.step_in_base_units(s.t_ns, s.readings, restarted=s.restarted)
        if outcome.breaches:
            return None
        is_last = s is snapshots[-1]
        expected.append(tuple(e for a in actuators for e in _expected(interpreter, a, fields=is_last)))
    return test_block(program, title, snapshots, expected)


def _expected(interpreter: Interpreter, actuator: Actuator, *, fields: bool) -> Iterator[ast.Expression]:
    """Yield what the interpreter decided for an actuator, and what it sent if a test can say so exactly."""
    values, name = interpreter.values, _reference(actuator.name)
    winner = values.winners[actuator.name]
    if winner is not None and _can_be_named(interpreter.program, winner):
        yield ast.By(actuator=name, module=_reference(winner))
    if actuator.name not in values.commanded:
        yield ast.Is(subject=name, status="idle")
    elif fields:
        for i, field in enumerate(actuator.fields):
            value = literal(field, values.sent[actuator.name, i])
            if value is not None:
                left = _reference(f"{actuator.name}.{field.name}")
                yield ast.Infix(operator="==", left=left, right=value)


def _can_be_named(program: Program, module: str) -> bool:
    """Return True unless a module is private to an imported file."""
    own = next(m.span.source for m in program.modules if m.name == module)
    return own is program.files[-1][1] or not module.rpartition(".")[2].startswith("_")


def _reference(name: str) -> ast.Reference:
    return ast.Reference(path=tuple(name.split(".")))
