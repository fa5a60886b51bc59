"""Substitution of the same subterms in many terms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar, cast

import z3

TermT = TypeVar("TermT", bound=z3.ExprRef)

_MAIN = z3.main_ctx()


class Substitution:
    """Replaces `before[i]` by `after[i]`, the largest terms first. Mutable: caches results.

    `z3.substitute` checks every pair in every call, which dominates the run time with thousands of terms;
    this passes z3 the same two arrays each time.
    """

    def __init__(self, before: Sequence[z3.ExprRef], after: Sequence[z3.ExprRef]) -> None:
        assert all(x.sort() == y.sort() for x, y in zip(before, after, strict=True))
        self._count = len(before)
        self._kept = (*before, *after)
        self._before = (z3.Ast * self._count)(*(x.as_ast() for x in before))
        self._after = (z3.Ast * self._count)(*(x.as_ast() for x in after))
        self._cache: dict[int, tuple[z3.ExprRef, z3.ExprRef]] = {}

    def __call__(self, term: TermT) -> TermT:
        """Return the term with all replacements made."""
        key = term.get_id()
        if key not in self._cache:
            self._cache[key] = (term, self._substitute(term))
        return cast(TermT, self._cache[key][1])

    def _substitute(self, term: z3.ExprRef) -> z3.ExprRef:
        ast = z3.Z3_substitute(_MAIN.ref(), term.as_ast(), self._count, self._before, self._after)
        if ast.value == term.as_ast().value:
            return term
        return z3.BoolRef(ast, _MAIN) if isinstance(term, z3.BoolRef) else z3.ArithRef(ast, _MAIN)
