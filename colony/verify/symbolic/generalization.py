"""Generalization of a system over rounding: proofs about the result hold bit for bit.

The reals do not determine which float the program computes, but they bound it. So each inexact term becomes a
free constant within bounds that rounding, being monotone, does not leave; sums of whole numbers stay exact
where they are small. Equal terms become the same constant, since the program computes them alike. Facts that
hold only for reals are dropped, and large numbers may overflow. The result over-approximates the program: all
of its runs in floats are runs of the result, but a counterexample in the result means nothing.

A *close* generalization also bounds the distance of each constant from its real, by the error of rounding
(Goldberg, 1991). It proves more, and slower.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import cast

import z3

from colony.verify.symbolic.bounding import between
from colony.verify.symbolic.encode import by_constant, with_reasons
from colony.verify.symbolic.logic import all_of, implied, negation, real
from colony.verify.symbolic.numbers import EXACT_WHOLE
from colony.verify.symbolic.system import (
    ActuatorTerms,
    Auxiliary,
    ExtendedReal,
    Fact,
    FactKind,
    Graph,
    Inexact,
    InexactTerm,
    ModuleTerms,
    NumberBounds,
    Operation,
    Scalar,
    System,
    Term,
)
from colony.verify.symbolic.unrolling import Substitution

OVERFLOW_BOUND = 2**1023
"""A bound below which no number overflows."""


_RELATIVE_ERROR = Fraction(1, 2**51)
_ABSOLUTE_ERROR = Fraction(1, 2**64)
"""Bounds of the error of an operation that rounds up to three times, of a result that does not overflow.

2**-1073 would be enough, but z3 is slow with numbers of a thousand digits.
"""


def generalize(system: System, *, close: bool = False) -> System:
    """Return `system` generalized so that claims that are valid in it hold bit for bit in floats.

    In it, `inexact` of a claim lists only terms that cannot be generalized, and modules in Python, whose
    answers are arbitrary in both systems. Use it only for proofs.
    """
    return with_reasons(generalized(system, close=close))


def generalized(system: System, *, close: bool = False) -> System:
    """Return `generalize(system)` with the claims' `inexact` as it is in `system`."""
    return _Generalization(system, close).system()


class _Generalization:
    """A generalization in progress: `term` replaces the largest inexact parts of a term."""

    def __init__(self, system: System, close: bool) -> None:
        self.original = system
        self._close = close
        self.terms = [t for t in system.inexact.values() if _can_be_free(t)]
        self.free_constants = [z3.Const(f"rounded#{i}", t.term.sort()) for i, t in enumerate(self.terms)]
        self.term = Substitution([t.term for t in self.terms], self.free_constants)

    def system(self) -> System:
        original = self.original
        found = (*self._facts(), *self._bounds(), *self._overflows())
        facts = [replace(fact, position=i) for i, fact in enumerate(found)]
        cells = tuple(replace(c, next=self.term(c.next)) for c in original.cells)
        return replace(  # the inputs of disturbances are exact, and stay
            original,
            cells=cells,
            assumptions=tuple(f.formula for f in facts if f.kind is FactKind.ASSUMPTION),
            definitions=tuple(f.formula for f in facts if f.kind is FactKind.DEFINITION),
            invariants=tuple(f.formula for f in facts if f.kind is FactKind.INVARIANT),
            auxiliaries=tuple(self._auxiliary(a) for a in original.auxiliaries),
            facts=by_constant(facts),
            inexact=self._still_inexact(),
            graph=Graph(cells),
            derived={n: (self.term(m), self.value(v)) for n, (m, v) in original.derived.items()},
            locals={n: self.value(v) for n, v in original.locals.items()},
            modules={n: self._module(m) for n, m in original.modules.items()},
            active={n: self.term(x) for n, x in original.active.items()},
            actuators={n: self._actuator(a) for n, a in original.actuators.items()},
            claims=tuple(replace(c, holds=self.term(c.holds)) for c in original.claims),
        )

    # --- terms -----------------------------------------------------------------------------------

    def scalar(self, x: Scalar) -> Scalar:
        if not isinstance(x, ExtendedReal):
            return self.term(x)
        return replace(
            x,
            value=self.term(x.value),
            nan=self.term(x.nan),
            infinite=self.term(x.infinite),
            whole=None if x.whole is None else self.term(x.whole),
            cases=tuple((v, self.term(c)) for v, c in x.cases),
            nanoseconds=None if x.nanoseconds is None else self.term(x.nanoseconds),
            branches=(),
        )

    def scalars(self, x: Sequence[Scalar]) -> tuple[Scalar, ...]:
        return tuple(self.scalar(v) for v in x)

    def value(self, x: Term) -> Term:
        return self.scalars(x) if isinstance(x, tuple) else self.scalar(x)

    def _module(self, module: ModuleTerms) -> ModuleTerms:
        return replace(
            module,
            silent=self.term(module.silent),
            blind=self.term(module.blind),
            applicable=self.term(module.applicable),
            active=self.term(module.active),
            command=self.scalars(module.command),
        )

    def _actuator(self, actuator: ActuatorTerms) -> ActuatorTerms:
        return replace(
            actuator,
            wins={m: self.term(w) for m, w in actuator.wins.items()},
            commanded=self.term(actuator.commanded),
            sent=self.scalars(actuator.sent),
        )

    def _auxiliary(self, auxiliary: Auxiliary) -> Auxiliary:
        operands = (cast(ExtendedReal, self.scalar(x)) for x in auxiliary.operands)
        return replace(auxiliary, operands=tuple(operands))

    # --- facts -----------------------------------------------------------------------------------

    def _facts(self) -> Iterable[Fact]:
        """Yield the facts that also hold for floats."""
        for facts in self.original.facts.values():
            for fact in facts:
                if not fact.only_over_reals:
                    yield replace(fact, formula=self.term(fact.formula))

    def _bounds(self) -> Iterable[Fact]:
        for inexact_term, free in zip(self.terms, self.free_constants, strict=True):
            if z3.is_arith(free):
                for formula in between(cast(z3.ArithRef, free), inexact_term.bounds):
                    yield Fact(FactKind.ASSUMPTION, free, formula)
                for formula in self._rounded(cast(z3.ArithRef, free), inexact_term):
                    is_number = negation(self.term(inexact_term.nan))
                    yield Fact(FactKind.ASSUMPTION, free, implied(is_number, formula))

    def _rounded(self, free: z3.ArithRef, inexact: InexactTerm) -> Iterator[z3.BoolRef]:
        """Yield what is known of the constant for a rounded result that is not NaN."""
        if inexact.is_sum and z3.is_int(free):
            yield self._is_exact(free, inexact)
        if self._close and inexact.reason.kind is Inexact.ROUNDING:
            yield self._is_close(free, inexact)

    def _exact(self, inexact: InexactTerm) -> z3.ArithRef:
        """Return the result of the operation of a term on floats, before it is rounded."""
        return cast(z3.ArithRef, inexact.term.decl()(*(self.term(x) for x in inexact.term.children())))

    def _is_exact(self, free: z3.ArithRef, inexact: InexactTerm) -> z3.BoolRef:
        """Return the condition that a constant is the sum of whole numbers for which it stands, if small."""
        exact = self._exact(inexact)
        is_small = all_of(between(exact, NumberBounds(-EXACT_WHOLE, EXACT_WHOLE)))
        return implied(is_small, cast(z3.BoolRef, free == exact))

    def _is_close(self, free: z3.ArithRef, inexact: InexactTerm) -> z3.BoolRef:
        """Return the condition that a constant is as close to the result of a term as rounding leaves it."""
        exact = self._exact(inexact)
        error = z3.If(exact < 0, -exact, exact) * real(_RELATIVE_ERROR)
        error = error if inexact.is_sum else error + real(_ABSOLUTE_ERROR)
        floats = (real(0), *(self.term(x) for x in inexact.floats))
        not_crossed = (
            side
            for x in floats
            for side in (z3.Implies(exact <= x, free <= x), z3.Implies(exact >= x, free >= x))
        )
        return z3.And(free <= exact + error, free >= exact - error, *not_crossed)

    def _overflows(self) -> Iterable[Fact]:
        for auxiliary in self.original.auxiliaries:
            if auxiliary.operation is Operation.OVERFLOW:
                value = self.term(auxiliary.operands[0].value)
                is_large = z3.Or(value >= real(OVERFLOW_BOUND), value <= real(-OVERFLOW_BOUND))
                formula = implied(cast(z3.BoolRef, auxiliary.constant), is_large)
                yield Fact(FactKind.ASSUMPTION, auxiliary.constant, formula)

    def _still_inexact(self) -> dict[int, InexactTerm]:
        """Return the terms that are still inexact."""
        return {
            key: inexact_term
            for key, inexact_term in self.original.inexact.items()
            if inexact_term.ambiguous or inexact_term.reason.kind is Inexact.PYTHON
        }


def _can_be_free(inexact_term: InexactTerm) -> bool:
    """Return True if a term stands for a single float and is not already a constant."""
    kind = inexact_term.reason.kind
    return kind is not Inexact.PYTHON and not inexact_term.ambiguous and inexact_term.term.num_args() > 0
