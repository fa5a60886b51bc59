"""Contracts under assumptions: what must hold in each frame up to which every assumption has held.

An assumption is a let that is true or missing in the frames that it allows. Under assumptions a contract C is
the contract `held and now implies C`, where `now` is that they hold in this frame and `held` a state: that
they held in all frames before. So no part of the prover knows of assumptions: a proof is one of a program
with a state more, and a run refutes it only if no assumption is broken up to its last frame.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

import z3

from colony.ir.expression import Binary, Expression, StateValue, ValueOr
from colony.ir.program import Contract, Program, State, assumptions, without_assumed
from colony.ir.types import BOOL
from colony.text.diagnostics import Diagnostic, Label, error, warning
from colony.text.wording import quoted
from colony.verify.claims import binary, implies
from colony.verify.contracts.candidates import HELD
from colony.verify.contracts.results import ProofOptions
from colony.verify.contracts.slicing import cone_of, facts, needs_of_slices, slice_of
from colony.verify.contracts.solver import Budget, Deadline, IncrementalSolver, SolverAnswer
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.generalization import generalize
from colony.verify.symbolic.unrolling import Unrolling


def under(program: Program, names: Collection[str]) -> Program:
    """Return the program with its contracts, but those that are assumed, under the assumptions `names`."""
    required = without_assumed(program)
    assumed = [a for a in assumptions(program) if a.name in names]
    if not assumed:
        return required
    state, held = held_so_far(HELD, assumed)
    contracts = tuple(
        replace(
            c,
            expression=replace(implies(held, c.expression), span=c.expression.span),
            assuming=tuple(a.name for a in assumed),
        )
        for c in required.contracts
    )
    return replace(required, derived=(*required.derived, state), contracts=contracts)


def held_so_far(name: str, assumed: Iterable[Contract]) -> tuple[State, Expression]:
    """Return a state that remembers whether assumptions held, and the condition that they hold up to now."""
    held: Expression = StateValue(type=BOOL, name=name)
    for assumption in assumed:
        held = binary(Binary.AND, held, assumption.expression)
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
