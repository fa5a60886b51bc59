"""Property-directed reachability (Bradley, 2011; Komuravelli, Gurfinkel and Chaki, 2014) by z3's Spacer.

A cone as Horn clauses: the initial memory is reachable, memory is reachable if a frame leads there from
reachable memory, and no frame from reachable memory may break the contract. Spacer answers with an invariant
that excludes such a frame, or with the number of frames of a run that ends in one. Neither is believed: the
parts of the invariant are guesses for `candidates.py`, and the run is searched for at that length.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import z3

from colony.verify.contracts.candidates import Candidate, initially_true
from colony.verify.contracts.solver import Budget
from colony.verify.interruption import interruptible
from colony.verify.symbolic import unrolling
from colony.verify.symbolic.system import Claim, System
from colony.verify.symbolic.unrolling import Cone

_OPTIONS = {
    "engine": "spacer",
    "xform.slice": False,  # these three would remove the relation with the invariant
    "xform.inline_eager": False,
    "xform.inline_linear": False,
}

_MAX_LENGTH = 160
"""Maximum length of the text of a guess; a longer one is cut."""

_INFIX = {
    z3.Z3_OP_OR: "or",
    z3.Z3_OP_AND: "and",
    z3.Z3_OP_IMPLIES: "implies",
    z3.Z3_OP_EQ: "==",
    z3.Z3_OP_DISTINCT: "!=",
    z3.Z3_OP_LE: "<=",
    z3.Z3_OP_LT: "<",
    z3.Z3_OP_GE: ">=",
    z3.Z3_OP_GT: ">",
    z3.Z3_OP_ADD: "+",
    z3.Z3_OP_SUB: "-",
    z3.Z3_OP_MUL: "*",
}

_NEGATED = {
    z3.Z3_OP_EQ: "!=",
    z3.Z3_OP_LE: ">",
    z3.Z3_OP_LT: ">=",
    z3.Z3_OP_GE: "<",
    z3.Z3_OP_GT: "<=",
}


class Broken(NamedTuple):
    """A run of `frames` frames breaks the contract in its last frame; none of up to `safe_frames` does."""

    frames: int
    safe_frames: int


class Safe(NamedTuple):
    """No run breaks the contract, as all of `guesses` are true of memory before every frame."""

    guesses: tuple[Candidate, ...]


def solve(
    system: System,
    claim: Claim,
    lemmas: Sequence[z3.BoolRef],
    budget: Budget,
    share: float,
    *,
    guided: bool = False,
) -> Safe | Broken | None:
    """Return Spacer's answer about a contract, None if it gave up.

    It may use `share` of the initial resources of a budget. `lemmas` hold in every frame. With `guided`, it
    generalizes over many clauses of its invariant at once (Vediramana Krishnan et al., 2020), which is slower
    but ends more often.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed while z3 was at work.
    """
    if budget.is_spent():
        return None
    cone = unrolling.cone(system, [claim.holds, *lemmas])
    clauses = _Clauses(cone, claim.holds, lemmas, guided=guided)
    answer = clauses.query(budget.part(share))
    budget.charge(clauses.resources_used())
    if answer == z3.sat:
        return clauses.broken()
    if answer == z3.unsat:
        guesses = [Candidate(formula_text(g), g) for g in clauses.invariant()]
        return Safe(initially_true(cone, guesses))
    return None


class _Clauses:
    """The Horn clauses of a cone, in a context of their own.

    So the cost of an answer hardly depends on what z3 has done before.
    """

    def __init__(self, cone: Cone, holds: z3.BoolRef, lemmas: Sequence[z3.BoolRef], *, guided: bool) -> None:
        self._cells = [cell.old for cell in cone.cells]
        self._context = z3.Context()
        memory = self._own(self._cells)
        facts = self._own([*cone.assumptions, *cone.definitions, *cone.invariants, *lemmas])
        boolean = z3.BoolSort(self._context)  # no constant of a program has one of the two names below
        self._reachable = z3.Function("memory is reachable", *(x.sort() for x in memory), boolean)
        self._broken = z3.Function("contract is broken", boolean)
        self._z3 = z3.Fixedpoint(ctx=self._context)
        self._z3.set(**_OPTIONS, **{"spacer.global": guided})
        self._z3.register_relation(self._reachable, self._broken)
        self._z3.declare_var(*memory, *self._own(cone.constants))
        frame = [self._reachable(*memory), *facts]
        self._z3.rule(self._reachable(*self._own([c.initial for c in cone.cells])))
        self._z3.rule(self._reachable(*self._own([c.next for c in cone.cells])), frame)
        self._z3.rule(self._broken(), [*frame, z3.Not(*self._own([holds]))])

    def _own(self, terms: Sequence[z3.ExprRef]) -> list[z3.ExprRef]:
        return [term.translate(self._context) for term in terms]

    def query(self, limit: int) -> z3.CheckSatResult:
        """Return whether a run breaks the contract, `unknown` if that takes more than a limit."""
        self._z3.set(rlimit=limit)
        with interruptible(self._context):
            try:
                answer = self._z3.query(self._broken())
            except z3.Z3Exception:  # a limit, or an operation that Spacer does not know
                return z3.unknown
        if answer == z3.unknown and self.resources_used() < limit and "cancel" in self._z3.reason_unknown():
            raise KeyboardInterrupt  # which z3's own handler reports in the same words as a limit
        return answer

    def resources_used(self) -> int:
        """Return the resources used by the query, in z3's units."""
        return self._statistic("rlimit count")

    def broken(self) -> Broken:
        """Return the length of the run that breaks the contract; the initial memory counts in Spacer's."""
        length, shortest = self._statistic("SPACER cex depth"), self._statistic("SPACER max depth")
        return Broken(length - 1, min(length, shortest) - 2)

    def invariant(self) -> list[z3.BoolRef]:
        """Return the conjuncts of the invariant, over the cells."""
        found = self._z3.get_cover_delta(-1, self._reachable).translate(z3.main_ctx())
        invariant = z3.simplify(z3.substitute_vars(found, *self._cells))
        return invariant.children() if z3.is_and(invariant) else [invariant]

    def _statistic(self, name: str) -> int:
        """Return a number of z3's statistics, 0 if it does not have it."""
        return int(dict(list(self._z3.statistics())).get(name, 0))


# --- text ----------------------------------------------------------------------------------------


def formula_text(formula: z3.ExprRef) -> str:
    """Return a formula as text, cut to a length that can be read."""
    text = _text(formula, _MAX_LENGTH)
    return text if len(text) <= _MAX_LENGTH else f"{text[: _MAX_LENGTH - 3]}..."


def _text(term: z3.ExprRef, room: int) -> str:
    """Return a term as text, or the beginning of one that is longer than `room`."""
    kind, operands = term.decl().kind() if z3.is_app(term) else None, term.children()
    if room <= 0:
        return "..."
    if z3.is_rational_value(term):
        return f"{float(term.as_fraction()):.15g}"
    if kind == z3.Z3_OP_NOT and operands[0].decl().kind() in _NEGATED:
        return _joined(_NEGATED[operands[0].decl().kind()], operands[0].children(), room)
    if kind == z3.Z3_OP_NOT:
        return f"not {_operand(operands[0], room)}"
    if kind in (z3.Z3_OP_TO_REAL, z3.Z3_OP_TO_INT):
        return _text(operands[0], room)
    if kind in _INFIX:
        return _joined(_INFIX[kind], operands, room)
    if kind == z3.Z3_OP_ITE:
        parts = zip(("if", "then", "else"), operands, strict=True)
        return " ".join(f"{word} {_operand(part, room)}" for word, part in parts)
    return str(term)


def _joined(symbol: str, operands: list[z3.ExprRef], room: int) -> str:
    parts: list[str] = []
    for operand in operands:
        parts.append(_operand(operand, room - sum(map(len, parts))))
    return f" {symbol} ".join(parts)


def _operand(term: z3.ExprRef, room: int) -> str:
    """Return an operand, in parentheses if it has operands of its own."""
    text = _text(term, room)
    return f"({text})" if " " in text and not text.startswith("not ") and term.num_args() > 1 else text
