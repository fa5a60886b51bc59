"""Moments of runs that tests and proofs consist of: failing tests, and counterexamples of contracts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from colony.ir.expression import Expression
from colony.ir.frame import Frame
from colony.ir.program import Example, Program
from colony.verify.explain.answer import Explanation, explain_condition
from colony.verify.explain.history import Historian
from colony.verify.explain.moment import Moment, moment_of
from colony.verify.reference.interpreter import Interpreter
from colony.verify.snapshot import Snapshot
from colony.verify.testing.examples import ExampleFailure
from colony.verify.testing.frames import snapshots_of


def moments(
    program: Program,
    snapshots: Sequence[Snapshot],
    expectations: Mapping[int, Sequence[Expression]] | None = None,
) -> Iterator[Moment]:
    """Yield the moment of each frame of a run from the program's initial memory.

    `expectations` are conditions that are evaluated in some frames, by their index, in order: what they
    remember is part of the run.

    Raises:
        DiagnosticError: a module in Python cannot be imported or built.
    """
    interpreter, historian = Interpreter(program), Historian(program)
    for k, snapshot in enumerate(snapshots):
        before, earlier = interpreter.state, historian.history
        outcome = interpreter.step_in_base_units(
            snapshot.t_ns, snapshot.readings, snapshot.lost, snapshot.given, restarted=snapshot.restarted
        )
        after = interpreter.state
        assert after is not None, "a frame was decided"
        winners = {d.actuator: d.by for d in outcome.decisions}
        history = historian.take(interpreter, after.memory.functions, winners, first=k == 0)
        yield moment_of(
            program,
            interpreter,
            before,
            history,
            k=k,
            frame=Frame(snapshot.t_ns, snapshot.readings, restarted=snapshot.restarted),
            outcome=outcome,
            absent={},
            earlier=earlier,
            lost=snapshot.lost,
            late=frozenset(a for a, given in snapshot.given.items() if given.values is None),
        )
        for expectation in (expectations or {}).get(k, ()):
            interpreter.value_of(expectation)


def explain_failure(program: Program, example: Example, failure: ExampleFailure) -> Explanation | None:
    """Return why an expectation or a contract was not true when a test failed.

    None if the failure is of another kind: an element of a missing array was set.

    Raises:
        DiagnosticError: a module in Python cannot be imported or built.
    """
    expectations: dict[int, Sequence[Expression]] = {}
    failed: tuple[str, Expression] | None = None
    for step in example.steps:
        for _ in step.times_ns:
            expectations[len(expectations)] = step.expectations
        for expectation in step.expectations:
            if expectation.span == failure.span and failure.t_ns in step.times_ns:
                failed = failure.expected, expectation
    for contract in program.contracts:
        if contract.span == failure.span:
            failed = contract.name, contract.expression
    if failed is None:
        return None
    run = moments(program, snapshots_of(program, example), expectations)
    moment = next(m for m in run if m.t_ns == failure.t_ns)
    return explain_condition(moment, *failed)


def explain_breach(program: Program, contract: str, snapshots: Sequence[Snapshot]) -> Explanation:
    """Return why a contract is not true in the last frame of a run of `program`."""
    *_, last = moments(program, snapshots)
    expression = next(c.expression for c in program.contracts if c.name == contract)
    return explain_condition(last, contract, expression)
