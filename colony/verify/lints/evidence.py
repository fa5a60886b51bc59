"""What claims concrete runs break, and how: by the examples of the program, and by frames drawn at random."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from random import Random

from colony.ir.expression import Expression
from colony.ir.frame import Outcome, Reading
from colony.ir.program import Contract, Module, Program
from colony.ir.types import Value
from colony.verify.contracts.replay import Replay
from colony.verify.contracts.results import Snapshot
from colony.verify.difference.sampling import frames
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.example_frames import frames_of

Claims = Mapping[str, Expression]


def with_claims(program: Program, claims: Claims) -> Program:
    """The program with claims for contracts."""
    contracts = tuple(Contract(name=name, expression=e) for name, e in claims.items())
    return replace(program, contracts=contracts)


def broken(
    program: Program, observed: Program, claims: Claims, random: Random, runs: int, length: int
) -> frozenset[str]:
    """The claims about `observed` that some run breaks.

    Runs are the examples of `program`, then `runs` of `length` frames, until none is left. A program with
    modules in Python is not run: its answers would be those of stand-ins.
    """
    left = dict(claims)
    if _asks_python(program):
        return frozenset()
    for trace in (*_examples(program), *(tuple(frames(program, random, length)) for _ in range(runs))):
        if not left:
            break
        for name in _breaches(with_claims(observed, left), trace):
            left.pop(name, None)
    return frozenset(set(claims) - set(left))


def _asks_python(program: Program) -> bool:
    return not all(isinstance(m, Module) for m in program.modules)


def _breaches(program: Program, trace: Sequence[Snapshot]) -> set[str]:
    """The claims that one run breaks."""
    interpreter, found = Interpreter(program), set[str]()
    for snapshot in trace:
        outcome = interpreter.step_in_base_units(snapshot.t_ns, snapshot.readings)
        found.update(outcome.breaches)
        if len(found) == len(program.contracts):
            break
    return found


def _examples(program: Program) -> Iterator[tuple[Snapshot, ...]]:
    """The frames of the program's own tests."""
    factors = {s.name: s.factor for s in program.robot.sensors}
    for example in program.tests:
        yield tuple(
            Snapshot(
                t_ns=frame.t_ns,
                readings={n: _based(x, factors[n]) for n, x in frame.readings.items() if x is not None},
            )
            for frame in frames_of(program, example)
        )


def _based(reading: Reading, factor: float) -> Value:
    """A reading in base units."""
    if isinstance(reading, Sequence):
        return tuple(x if isinstance(x, bool) else x * factor for x in reading)
    assert reading is not None
    return reading if isinstance(reading, bool) else reading * factor


def replayed(program: Program, snapshots: Iterable[Snapshot]) -> tuple[Outcome, ...]:
    """What the reference interpreter does."""
    return Replay(program, "").run(tuple(snapshots))
