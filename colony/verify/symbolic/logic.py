"""Constructors of small formulas: connectives with constant or equal operands are simplified."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import TypeVar, cast

import z3

TermT = TypeVar("TermT", bound=z3.ExprRef)

TRUE: z3.BoolRef = z3.BoolVal(True)
FALSE: z3.BoolRef = z3.BoolVal(False)

# Encoding makes thousands of terms. z3's Python functions check the class and sort of every operand; types
# guarantee them here, so these functions call z3's C interface directly, in the main context.
_MAIN = z3.main_ctx()
_CONTEXT = _MAIN.ref()


class _Negation(z3.BoolRef):  # type: ignore[misc]
    """A `not` that keeps its operand, which z3 would wrap again."""

    operand: z3.BoolRef


def _truth_of(ast: z3.Ast) -> z3.BoolRef:
    return z3.BoolRef(ast, _MAIN)


def _array(terms: Sequence[z3.ExprRef]) -> object:
    return (z3.Ast * len(terms))(*(x.as_ast() for x in terms))


def is_true(x: z3.BoolRef) -> bool:
    """Return True if `x` is `TRUE`, the only form in which these functions return it."""
    return x is TRUE


def is_false(x: z3.BoolRef) -> bool:
    """Return True if `x` is `FALSE`."""
    return x is FALSE


def same(x: z3.ExprRef, y: z3.ExprRef) -> bool:
    """Return True if the terms are identical: z3 shares equal terms."""
    return x is y or bool(x.ast.value == y.ast.value)


def truth(x: bool) -> z3.BoolRef:
    """Return the constant of a truth value."""
    return TRUE if x else FALSE


def negation(x: z3.BoolRef) -> z3.BoolRef:
    """Return the negation of a formula, simplified."""
    if is_true(x):
        return FALSE
    if is_false(x):
        return TRUE
    if isinstance(x, _Negation):
        return x.operand
    if z3.Z3_get_decl_kind(_CONTEXT, z3.Z3_get_app_decl(_CONTEXT, x.ast)) == z3.Z3_OP_NOT:
        return cast(z3.BoolRef, x.arg(0))
    result = _Negation(z3.Z3_mk_not(_CONTEXT, x.ast), _MAIN)
    result.operand = x
    return result


def all_of(formulas: Iterable[z3.BoolRef]) -> z3.BoolRef:
    """Return the conjunction of formulas, simplified."""
    kept = _kept(formulas, neutral=TRUE, absorbing=FALSE)
    if kept is None:
        return FALSE
    if len(kept) < 2:
        return kept[0] if kept else TRUE
    return _truth_of(z3.Z3_mk_and(_CONTEXT, len(kept), _array(kept)))


def any_of(formulas: Iterable[z3.BoolRef]) -> z3.BoolRef:
    """Return the disjunction of formulas, simplified."""
    kept = _kept(formulas, neutral=FALSE, absorbing=TRUE)
    if kept is None:
        return TRUE
    if len(kept) < 2:
        return kept[0] if kept else FALSE
    return _truth_of(z3.Z3_mk_or(_CONTEXT, len(kept), _array(kept)))


def _kept(
    formulas: Iterable[z3.BoolRef], neutral: z3.BoolRef, absorbing: z3.BoolRef
) -> list[z3.BoolRef] | None:
    """Return the distinct operands; None if one, or a pair of opposites, decides the result."""
    kept: dict[int, z3.BoolRef] = {}
    for x in formulas:
        if x is absorbing:
            return None
        if x is not neutral:
            kept[x.ast.value] = x
    if len(kept) > 1:
        for x in kept.values():
            if isinstance(x, _Negation) and x.operand.ast.value in kept:
                return None
    return list(kept.values())


def both(x: z3.BoolRef, y: z3.BoolRef) -> z3.BoolRef:
    """Return the conjunction of two formulas."""
    return all_of((x, y))


def either(x: z3.BoolRef, y: z3.BoolRef) -> z3.BoolRef:
    """Return the disjunction of two formulas."""
    return any_of((x, y))


def implied(x: z3.BoolRef, y: z3.BoolRef) -> z3.BoolRef:
    """Return `x implies y`."""
    return any_of((negation(x), y))


def equivalent(x: z3.BoolRef, y: z3.BoolRef) -> z3.BoolRef:
    """Return the equivalence of two formulas, simplified."""
    if same(x, y):
        return TRUE
    for constant, formula in ((x, y), (y, x)):
        if is_true(constant):
            return formula
        if is_false(constant):
            return negation(formula)
    return cast(z3.BoolRef, x == y)


def choice(condition: z3.BoolRef, yes: z3.BoolRef, no: z3.BoolRef) -> z3.BoolRef:
    """Return `if condition then yes else no` for formulas."""
    if is_true(condition) or same(yes, no):
        return yes
    if is_false(condition):
        return no
    if is_true(yes):
        return either(condition, no)
    if is_false(yes):
        return both(negation(condition), no)
    if is_true(no):
        return either(negation(condition), yes)
    if is_false(no):
        return both(condition, yes)
    return _ite(condition, yes, no)


def pick(condition: z3.BoolRef, yes: TermT, no: TermT) -> TermT:
    """Return `if condition then yes else no` for terms of one sort."""
    if is_true(condition) or same(yes, no):
        return yes
    if is_false(condition):
        return no
    return _ite(condition, yes, no)


def _ite(condition: z3.BoolRef, yes: TermT, no: TermT) -> TermT:
    """Return the choice as a term of z3, without simplifying it."""
    ast = z3.Z3_mk_ite(_CONTEXT, condition.as_ast(), yes.as_ast(), no.as_ast())
    return cast(TermT, z3.BoolRef(ast, _MAIN) if isinstance(yes, z3.BoolRef) else z3.ArithRef(ast, _MAIN))


@lru_cache(maxsize=4096)
def real(x: Fraction | int) -> z3.RatNumRef:
    """Return the numeral of sort Real."""
    return z3.RealVal(str(x))


@lru_cache(maxsize=4096)
def integer(x: int) -> z3.IntNumRef:
    """Return the numeral of sort Int."""
    return z3.IntVal(x)
