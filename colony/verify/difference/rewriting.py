"""Renaming of what an expression reads, and of its memory cells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from colony.ir import expression as ir

Rename = Callable[[str], str]


def rewrite_expression(e: ir.Expression, rename: Rename, shift: int) -> ir.Expression:
    """Return `e` with derived values, states and modules' lets renamed, and cells shifted by `shift`.

    Sensors keep their names. `e` is not the expression of a contract.
    """
    rewrite = partial(rewrite_expression, rename=rename, shift=shift)
    match e:
        case ir.DerivedValue(name=name) | ir.LocalValue(name=name) | ir.StateValue(name=name):
            return replace(e, name=rename(name))
        case ir.Fresh(name=name, derived=derived):
            return replace(e, name=rename(name)) if derived else e
        case ir.MemoryCall():
            return ir.rebuilt(replace(e, cell=e.cell + shift), rewrite)
        case _:
            return ir.rebuilt(e, rewrite)
