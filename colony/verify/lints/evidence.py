"""Concrete runs that refute claims: the program's examples, and frames drawn at random."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from random import Random

from colony.ir import expression as ir
from colony.ir.expression import Expression
from colony.ir.frame import Outcome
from colony.ir.program import Contract, Module, Program
from colony.ir.types import BOOL
from colony.verify.claims import TRUE
from colony.verify.contracts.replay import Replay
from colony.verify.reference.interpreter import Interpreter
from colony.verify.snapshot import Snapshot, snapshot_of
from colony.verify.testing.drawing import Choices
from colony.verify.testing.example_frames import snapshots_of
from colony.verify.testing.frames import draw_trace

_RUNS = 12
_FRAMES = 30

Claims = Mapping[str, Expression]


def with_claims(program: Program, claims: Claims) -> Program:
    """Return the program with claims in place of its contracts; what is unknown breaks no claim."""
    contracts = tuple(
        Contract(name=name, expression=ir.ValueOr(type=BOOL, expression=e, other=TRUE))
        for name, e in claims.items()
    )
    return replace(program, contracts=contracts)


def broken_claims(program: Program, instrumented: Program, claims: Claims) -> frozenset[str]:
    """Return the claims about `instrumented` that a run breaks.

    The runs are the examples of `program`, then drawn traces, until every claim is broken. A program with
    modules in Python is not run, as their answers are unknown.
    """
    unbroken_claims = dict(claims)
    if _has_python_modules(program):
        return frozenset()
    for trace in chain((snapshots_of(program, t) for t in program.tests), _random_traces(program)):
        if not unbroken_claims:
            break
        for name in _breaches(with_claims(instrumented, unbroken_claims), trace):
            unbroken_claims.pop(name, None)
    return frozenset(set(claims) - set(unbroken_claims))


def _random_traces(program: Program) -> Iterator[tuple[Snapshot, ...]]:
    for number in range(_RUNS):
        frames = draw_trace(Choices(Random(f"0/{number}")), program, _FRAMES)
        yield tuple(snapshot_of(program, frame) for frame in frames)


def _has_python_modules(program: Program) -> bool:
    return not all(isinstance(m, Module) for m in program.modules)


def _breaches(program: Program, trace: Sequence[Snapshot]) -> set[str]:
    """Return the claims that one run breaks."""
    interpreter, found = Interpreter(program), set[str]()
    for snapshot in trace:
        outcome = interpreter.step_in_base_units(
            snapshot.t_ns, snapshot.readings, restarted=snapshot.restarted
        )
        found.update(outcome.breaches)
        if len(found) == len(program.contracts):
            break
    return found


def replay(program: Program, snapshots: Iterable[Snapshot]) -> tuple[Outcome, ...]:
    """Return the reference interpreter's outcomes."""
    return tuple(outcome for outcome, _ in frames(program, snapshots))


def frames(program: Program, snapshots: Iterable[Snapshot]) -> Iterator[tuple[Outcome, Interpreter]]:
    """Yield the outcome of each frame, with the reference interpreter as it is after that frame."""
    return Replay(program, "").frames(tuple(snapshots))
