"""Contracts under assumptions: what must hold in each frame up to which every assumption has held.

An assumption is a let that is true or missing in the frames that it allows. Under assumptions a contract C is
the contract `held and now implies C`, where `now` is that they hold in this frame and `held` a state: that
they held in all frames before. So no part of the prover knows of assumptions: a proof is one of a program
with a state more, and a run refutes it only if no assumption is broken up to its last frame.

What was sent before (`last.ACTUATOR.FIELD`) is as free as any sensor. Under assumptions it is within the
limits of the frame before, to which arbitration holds programs and operators alike.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import z3

from colony.ir.expression import (
    Binary,
    BinaryOperation,
    Expression,
    Function,
    FunctionCall,
    MemoryCall,
    SensorValue,
    StateValue,
    ValueOr,
    subexpressions,
)
from colony.ir.program import Contract, Limit, Program, Sensor, State, assumptions, without_assumed
from colony.ir.types import BOOL, Quantity
from colony.text.diagnostics import Diagnostic, Label, error, warning
from colony.text.wording import quoted
from colony.verify.claims import TRUE, all_of, any_of, binary, constant, implies, negation, value_or
from colony.verify.contracts.candidates import HELD
from colony.verify.contracts.results import ProofOptions
from colony.verify.contracts.slicing import cone_of, facts, needs_of_slices, slice_of
from colony.verify.contracts.solver import Budget, Deadline, IncrementalSolver, SolverAnswer
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.generalization import generalize
from colony.verify.symbolic.unrolling import Unrolling


def under(program: Program, names: Collection[str]) -> Program:
    """Return the program with its contracts, but those that are assumed, under the assumptions `names`.

    They are also under the limits that the program's `last...` are subject to, if there are any.
    """
    required = without_assumed(program)
    assumed = [a for a in assumptions(program) if a.name in names]
    limited = _limited(program)
    if not assumed and not limited:
        return required
    now = (*(limit.kept for limit in limited), *(a.expression for a in assumed))
    state, held = held_so_far(HELD, now)
    contracts = tuple(
        replace(
            c,
            expression=replace(implies(held, c.expression), span=c.expression.span),
            assuming=tuple(a.name for a in assumed),
        )
        for c in required.contracts
    )
    states = (state for limit in limited for state in limit.states)
    return replace(required, derived=(*required.derived, *states, state), contracts=contracts)


def held_so_far(name: str, conditions: Iterable[Expression]) -> tuple[State, Expression]:
    """Return a state that remembers whether conditions held, and the condition that they hold up to now."""
    held = all_of((StateValue(type=BOOL, name=name), *conditions))
    return State(name=name, type=BOOL, initial=True, next=held), held


def related(program: Program, contract: str) -> tuple[str, ...]:
    """Return the assumptions about what a contract reads, and about what these read."""
    needs = needs_of_slices(program)
    left = {a.name: needs[a.name] for a in assumptions(program)}
    found, values = set[str](), needs[contract].values
    while more := [name for name, read in left.items() if read.values & values]:
        for name in more:
            found.add(name)
            values |= left.pop(name).values
    return tuple(a.name for a in assumptions(program) if a.name in found)


# --- limits of what was sent --------------------------------------------------------------------------


_GREATEST = 1e100
"""Bounds beyond it say nothing, as those that are not finite."""

_CONVERSION = 1e-12
"""Share by which a number may change where it is converted to a unit and back; some 2e-16 in fact."""


class _Limited(NamedTuple):
    """That a `last...` kept a limit of the frame before; `states` remember whether it applied, and where."""

    kept: Expression
    states: tuple[State, State]


def has_limits(program: Program) -> bool:
    """Return True if the program reads what a field with a limit was given in the frame before."""
    return bool(_limited(program))


def _limited(program: Program) -> list[_Limited]:
    """Return the limits of what the program reads of the frame before.

    A limit with memory of its own is left out: evaluated twice, it would be another.
    """
    read = {(s.sent.actuator, s.sent.of): s for s in program.robot.sensors if s.sent is not None}
    found = []
    for i, limit in enumerate(program.limits):
        sensor = read.get((limit.actuator, limit.field_index))
        parts = [limit.bound] if limit.condition is None else [limit.bound, limit.condition]
        if sensor is None or sensor.default is None:
            continue
        if not any(isinstance(e, MemoryCall) for part in parts for e in subexpressions(part)):
            found.append(_kept(i, limit, sensor))
    return found


def _kept(number: int, limit: Limit, sensor: Sensor) -> _Limited:
    """Return that `sensor`, converted to its unit and back, kept `limit` in the frame before.

    The idle command and a standstill go out whatever the limits. A bound that is not finite says nothing.
    """
    type_ = limit.bound.type
    assert isinstance(type_, Quantity)
    magnitude = FunctionCall(type=type_, function=Function.ABS, arguments=(limit.bound,))
    is_finite = binary(Binary.LESS, magnitude, constant(_GREATEST, type_))
    asked = is_finite if limit.condition is None else binary(Binary.AND, limit.condition, is_finite)
    applied = State(name=f"limit {number} applied", type=BOOL, initial=False, next=value_or(asked, TRUE))
    standing = constant(float(sensor.default or 0.0), type_)
    bound = State(
        name=f"limit {number}",
        type=type_,
        initial=float(sensor.default or 0.0),
        next=value_or(limit.bound, standing),
    )
    field = SensorValue(type=type_, name=sensor.name)
    is_upper = limit.relation == "<="
    before = StateValue(type=type_, name=bound.name)
    edges = tuple(
        BinaryOperation(type=type_, operator=Binary.MULTIPLY, left=before, right=constant(factor, Quantity()))
        for factor in (1 - _CONVERSION, 1 + _CONVERSION)
    )
    edge = FunctionCall(type=type_, function=Function.MAX if is_upper else Function.MIN, arguments=edges)
    kept = any_of(
        (
            negation(StateValue(type=BOOL, name=applied.name)),
            binary(Binary.LESS_EQUAL if is_upper else Binary.GREATER_EQUAL, field, edge),
            binary(Binary.EQUAL, field, standing),
            binary(Binary.EQUAL, field, constant(0.0, type_)),
        )
    )
    return _Limited(kept, (applied, bound))


# --- assumptions that cannot be met -------------------------------------------------------------------

_FRAMES = 20
"""Number of frames of the runs in which every assumption is to be met."""

_SHARE = 1 / 4
"""Share of a contract's budget for each question about assumptions."""


def doubtful_assumptions(program: Program, options: ProofOptions, deadline: Deadline) -> list[Diagnostic]:
    """Return an error for assumptions that no run meets, and a warning for each that is always true.

    An assumption is met by a run if it is true in one of its frames, and all are true or missing in each of
    them. Any rounding is allowed, so what is said to be impossible is.
    """
    assumed = assumptions(program)
    if not assumed:
        return []
    runs = _Runs(program, options, deadline)
    found: list[Diagnostic] = []
    contradicting = set[str]()
    for assumption in assumed:
        others = [a for a in assumed if a is not assumption and a.name not in contradicting]
        if runs.never_break(assumption):
            message = f"`{assumption.name}` is true or missing in every run: it assumes nothing"
            found.append(
                warning("V017", assumption.span, message, "remove it, or say what it should exclude")
            )
        elif assumption.name not in contradicting and runs.never_meet(assumption, others):
            needed = others
            for other in tuple(needed):
                fewer = [a for a in needed if a is not other]
                needed = fewer if runs.never_meet(assumption, fewer) else needed
            contradicting |= {assumption.name, *(a.name for a in needed)}
            found.append(_contradiction(assumption, needed))
    return found


def _contradiction(assumption: Contract, others: Sequence[Contract]) -> Diagnostic:
    message = f"no run of {_FRAMES} frames meets `{assumption.name}`"
    if others:
        message += f" where {quoted([a.name for a in others])} {'holds' if len(others) == 1 else 'hold'}"
    hint = "what is proved under it is about no run in which it is known: weaken one of them"
    return error("V016", assumption.span, message, hint, *(Label(a.span, "assumed here") for a in others))


class _Runs:
    """Runs of a program as formulas in which any rounding is allowed."""

    def __init__(self, program: Program, options: ProofOptions, deadline: Deadline) -> None:
        assumed = assumptions(program)
        known = [
            replace(a, name=_known(a.name), expression=a.expression.expression)
            for a in assumed
            if isinstance(a.expression, ValueOr)
        ]
        needed = slice_of(program, *assumed, *known)
        self._system = generalize(encode(needed))
        self._claims = {c.name: c for c in self._system.claims}
        self._options, self._deadline = options, deadline

    def never_break(self, assumption: Contract) -> bool:
        """Return True if no frame breaks an assumption, whatever memory is before it."""
        claim = self._claims[assumption.name]
        solver = IncrementalSolver(Budget(self._options, self._deadline, _SHARE))
        cone = cone_of(self._system, claim)
        solver.add(facts(cone), z3.Not(claim.holds))
        return solver.check() is SolverAnswer.UNSAT

    def never_meet(self, assumption: Contract, others: Sequence[Contract]) -> bool:
        """Return True if an assumption is true in no frame of the runs in which it and others hold."""
        claims = [self._claims[a.name] for a in (assumption, *others)]
        is_true = self._claims[_known(assumption.name)].holds
        cone = cone_of(self._system, *claims, self._claims[_known(assumption.name)])
        frames, solver = (
            Unrolling(self._system, cone),
            IncrementalSolver(Budget(self._options, self._deadline, _SHARE)),
        )
        solver.add(*frames.initial())
        for i in range(_FRAMES):
            solver.add(*frames.frame(i), *(frames.at(i, c.holds) for c in claims))
            if i + 1 < _FRAMES:
                solver.add(*frames.transition(i))
        solver.add(z3.Or(*(frames.at(i, is_true) for i in range(_FRAMES))))
        return solver.check() is SolverAnswer.UNSAT


def _known(name: str) -> str:
    return f"{name} is true"
