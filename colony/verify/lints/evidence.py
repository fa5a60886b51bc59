"""Concrete runs that refute claims: the program's examples, and frames drawn at random."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import chain
from random import Random

from colony.ir import expression as ir
from colony.ir.expression import Expression
from colony.ir.frame import Outcome
from colony.ir.program import Contract, Module, Program
from colony.ir.types import BOOL
from colony.verify.claims import TRUE
from colony.verify.contracts.concrete_runs import GeneratedRuns
from colony.verify.contracts.replay import Replay
from colony.verify.reference.interpreter import Interpreter
from colony.verify.snapshot import Snapshot, snapshot_of
from colony.verify.testing.drawing import Choices
from colony.verify.testing.example_frames import snapshots_of
from colony.verify.testing.frames import draw_trace

_RUNS = 12
_FRAMES = 30

_SMALL_PROGRAM = 1000
"""Maximum number of modules and sensors of a program that gets all of the runs; a larger one gets fewer."""

Claims = Mapping[str, Expression]


def with_claims(program: Program, claims: Claims) -> Program:
    """Return the program with claims in place of its contracts; what is unknown breaks no claim."""
    contracts = tuple(
        Contract(name=name, expression=ir.ValueOr(type=BOOL, expression=e, other=TRUE))
        for name, e in claims.items()
    )
    return replace(program, contracts=contracts)


def drawn_breaches(program: Program, runs: GeneratedRuns) -> list[frozenset[str]]:
    """Return the claims that are broken in each frame of the examples of `program` and of drawn traces.

    `runs` are those of the program with claims in place of its contracts.
    """
    traces = chain((snapshots_of(program, t) for t in program.tests), _random_traces(program))
    return [frozenset(outcome.breaches) for trace in traces for outcome in runs.outcomes(trace)]


def has_python_modules(program: Program) -> bool:
    """Return True if a program has modules in Python, whose answers in a run are unknown."""
    return not all(isinstance(m, Module) for m in program.modules)


def _random_traces(program: Program) -> Iterator[tuple[Snapshot, ...]]:
    size = len(program.modules) + len(program.robot.sensors)
    for number in range(max(2, _RUNS * _SMALL_PROGRAM // max(size, _SMALL_PROGRAM))):
        frames = draw_trace(Choices(Random(f"0/{number}")), program, _FRAMES)
        yield tuple(snapshot_of(program, frame) for frame in frames)


def replay(program: Program, snapshots: Iterable[Snapshot]) -> tuple[Outcome, ...]:
    """Return the reference interpreter's outcomes."""
    return tuple(outcome for outcome, _ in frames(program, snapshots))


def frames(program: Program, snapshots: Iterable[Snapshot]) -> Iterator[tuple[Outcome, Interpreter]]:
    """Yield the outcome of each frame, with the reference interpreter as it is after that frame."""
    return Replay(program, "").frames(tuple(snapshots))
