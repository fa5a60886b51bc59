"""Runs of the program itself that break contracts where formulas cannot decide: tests, long runs, drawn ones.

None of them is drawn from declarations that a contract does not depend on, so neither is its verdict.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from random import Random
from typing import assert_never

from colony.compile.backends.python.generate import generate, load
from colony.compile.pipeline import compile_program
from colony.ir.frame import Frame, Outcome
from colony.ir.program import Program, Sensor, is_regular, robot_in_base_units
from colony.ir.types import Array, Bool, Enum, Quantity, Scalar, ScalarValue, Value, element_type
from colony.verify.contracts.replay import Replay, is_stand_in, with_stand_ins
from colony.verify.snapshot import Snapshot, snapshot_of
from colony.verify.symbolic.system import Disturbance
from colony.verify.testing.disturbed import disturbed_run
from colony.verify.testing.frames import Choices, snapshots_of
from colony.verify.testing.guided import Guide

_TRACES = 150
_FRAMES = 8
"""Number and length of the drawn runs of the interpreter, each of which learns from those before."""

LONG_FRAMES = 1000
"""Length of a long run, in frames."""

_LONG_RUNS = 24
"""Number of long runs of a small program: in half of them no reading ever changes."""

_SMALL_CODE = 2000
"""Maximum number of nodes in the compiled form of a small program."""


def drawn_counterexample(
    program: Program, replay: Replay, disturbance: Disturbance | None = None
) -> tuple[Snapshot, ...] | None:
    """Return the first of a few drawn runs that breaks the contract, None if none does. Deterministic.

    With a disturbance, actuators are idle and modules lost in some frames; with `OPERATORS`, connections
    command actuators in others.
    """
    guide = Guide(program, _FRAMES)
    for seed in range(replay.affordable_runs(_TRACES, _FRAMES)):
        trace = guide.draw(Choices(Random(seed)))
        snapshots = tuple(snapshot_of(program, frame) for frame in trace)
        if disturbance is not None:
            operators = disturbance is Disturbance.OPERATORS
            disturbed = disturbed_run(Choices(Random(seed)), replay.program, trace, operators=operators)
            snapshots = tuple(
                snapshot._replace(given=frame.given, lost=frame.lost)
                for snapshot, frame in zip(snapshots, disturbed, strict=True)
            )
        outcomes, breach = replay.outcomes_and_breach(snapshots)
        if breach is not None:
            return snapshots
        guide.learn(trace, [tuple((d.by, d.fault) for d in o.decisions) for o in outcomes])
    return None


class GeneratedRuns:
    """Runs of a program in generated Python, from readings in base units. Stateful: holds an executor."""

    def __init__(self, program: Program) -> None:
        program = replace(program, robot=robot_in_base_units(program.robot), tests=())
        compiled = compile_program(program).compiled
        self.size = len(compiled.code.ops)  # of the program, in nodes of its compiled form
        self._executor = load(generate(compiled))

    def outcomes(self, trace: Iterable[Snapshot]) -> Iterator[Outcome]:
        """Yield the outcome of each frame of a run that begins with the initial memory."""
        self._executor.restart()
        for s in trace:
            yield self._executor.step(Frame(s.t_ns, s.readings, restarted=s.restarted))


class LongRuns:
    """Tests and long runs of one program, in generated Python. Stateful: run when first asked for.

    All contracts are evaluated in the same runs. Modules in Python answer "not applicable".
    """

    def __init__(self, program: Program) -> None:
        self._program = program
        self._breaking: dict[str, tuple[Snapshot, ...]] | None = None

    def breaking(self, contract: str) -> tuple[Snapshot, ...] | None:
        """Return a run whose last frame breaks the contract in generated Python, None if none does."""
        if self._breaking is None:
            self._breaking = {}
            for snapshots, broken in self._broken():
                self._breaking.setdefault(broken, snapshots)
        return self._breaking.get(contract)

    def _broken(self) -> Iterator[tuple[tuple[Snapshot, ...], str]]:
        """Yield each contract that a run breaks, with the run up to there."""
        program = with_stand_ins(self._program)
        runs = GeneratedRuns(program)
        count = max(2, int(_LONG_RUNS * min(1, _SMALL_CODE / runs.size)))
        for snapshots in (*self._tests(), *(_long_run(program, i) for i in range(count))):
            seen = set[str]()
            for i, outcome in enumerate(runs.outcomes(snapshots), 1):
                for name in set(outcome.breaches) - seen:
                    seen.add(name)
                    yield snapshots[:i], name

    def _tests(self) -> Iterator[tuple[Snapshot, ...]]:
        for example in self._program.tests:
            snapshots = snapshots_of(self._program, example)
            if is_regular(self._program.robot, (s.t_ns for s in snapshots)):
                yield snapshots


# --- long runs -----------------------------------------------------------------------------------


def _long_run(program: Program, number: int) -> tuple[Snapshot, ...]:
    """Return a run in which each sensor follows a signal of its own: constant, or in steps."""
    sensors = [s for s in program.robot.sensors if s.sent is None and not is_stand_in(s)]
    signals = [(s.name, _signal(s, number)) for s in sensors]
    snapshots = []
    for i in range(LONG_FRAMES):
        readings = {name: next(signal) for name, signal in signals}
        snapshots.append(
            Snapshot(i * program.robot.frame_ns, {n: x for n, x in readings.items() if x is not None})
        )
    return tuple(snapshots)


def _signal(sensor: Sensor, number: int) -> Iterator[Value | None]:
    """Yield the readings of a sensor in a run, None where it is missing; they depend on nothing else."""
    random = Random(f"{number} {sensor.name}")
    plain = plain_values(sensor)
    if number < 4:  # all at once: at their defaults, at an end of their ranges, and next to 0
        chosen = plain[min(number, len(plain) - 1)]
        while True:
            yield _filled(sensor, chosen)
    while True:
        value = None if random.random() < 1 / 16 else _drawn(sensor, plain, random)
        held = LONG_FRAMES if number % 2 == 0 else random.choice((1, 1, 2, 5, 20, 100))
        for _ in range(held):
            yield value


def _drawn(sensor: Sensor, plain: Sequence[ScalarValue], random: Random) -> Value:
    if not isinstance(sensor.type, Array) or random.random() < 1 / 2:
        return _filled(sensor, _scalar(sensor, plain, random))
    few = [_scalar(sensor, plain, random) for _ in range(3)]
    return tuple(random.choice(few) for _ in range(sensor.type.size))


def _scalar(sensor: Sensor, plain: Sequence[ScalarValue], random: Random) -> ScalarValue:
    if isinstance(element_type(sensor.type), Quantity) and random.random() < 1 / 2:
        low, high = _range(sensor)
        return random.uniform(low, high)
    return random.choice(plain)


def _filled(sensor: Sensor, value: ScalarValue) -> Value:
    return (value,) * sensor.type.size if isinstance(sensor.type, Array) else value


def plain_values(sensor: Sensor) -> list[ScalarValue]:
    """Return plain values in base units: the default or 0, the ends of the range, and tiny numbers."""
    of: Scalar = element_type(sensor.type)
    match of:
        case Bool():
            return [sensor.default is True, True, False]
        case Enum(members=members):
            return [value for _, value in members]
        case Quantity():
            low, high = _range(sensor)
            first = 0.0 if sensor.default is None else float(sensor.default)
            inner = (math.nextafter(low, high), math.nextafter(high, low), low / 3, high / 3)
            values = (first, low, high, -1e-20, *inner, 5e-324, -5e-324, 1e-20, 0.1, 1.0, -1.0)
            return [x for x in dict.fromkeys(values) if low <= x <= high]
        case _:
            assert_never(of)


def _range(sensor: Sensor) -> tuple[float, float]:
    """Return the range in base units; a thousand declared units where there is none."""
    low = -1000.0 * sensor.factor if sensor.low is None else sensor.low
    high = 1000.0 * sensor.factor if sensor.high is None else sensor.high
    return min(low, high), max(low, high)
