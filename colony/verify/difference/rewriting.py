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
        case ir.ValueOr():
            return replace(e, expression=rewrite(e.expression), other=rewrite(e.other))
        case ir.UnaryOperation():
            return replace(e, operand=rewrite(e.operand))
        case ir.BinaryOperation():
            return replace(e, left=rewrite(e.left), right=rewrite(e.right))
        case ir.Conditional():
            return replace(e, condition=rewrite(e.condition), yes=rewrite(e.yes), no=rewrite(e.no))
        case ir.Within():
            return replace(e, operand=rewrite(e.operand), low=rewrite(e.low), high=rewrite(e.high))
        case ir.Element():
            return replace(e, array=rewrite(e.array), index=rewrite(e.index))
        case ir.Slice():
            return replace(e, array=rewrite(e.array))
        case ir.Window():
            return replace(e, array=rewrite(e.array), center=rewrite(e.center))
        case ir.Call():
            return replace(e, arguments=tuple(rewrite(x) for x in e.arguments))
        case ir.Reduce():
            condition = None if e.condition is None else rewrite(e.condition)
            return replace(e, body=rewrite(e.body), condition=condition)
        case ir.MemoryCall():
            return replace(e, arguments=tuple(rewrite(x) for x in e.arguments), cell=e.cell + shift)
        case _:
            return e
