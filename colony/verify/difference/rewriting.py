"""An expression with other names in it, and memory of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from colony.ir import expression as ir

Rename = Callable[[str], str]


def rewritten(e: ir.Expression, rename: Rename, shift: int) -> ir.Expression:
    """Return `e` with derived values, states and modules' lets renamed, and cells shifted by `shift`.

    Sensors keep their names. `e` is no contract expression.
    """
    again = partial(rewritten, rename=rename, shift=shift)
    match e:
        case ir.DerivedValue(name=name) | ir.LocalValue(name=name) | ir.StateValue(name=name):
            return replace(e, name=rename(name))
        case ir.Fresh(name=name, derived=derived):
            return replace(e, name=rename(name)) if derived else e
        case ir.ValueOr():
            return replace(e, expression=again(e.expression), other=again(e.other))
        case ir.UnaryOperation():
            return replace(e, operand=again(e.operand))
        case ir.BinaryOperation():
            return replace(e, left=again(e.left), right=again(e.right))
        case ir.Conditional():
            return replace(e, condition=again(e.condition), yes=again(e.yes), no=again(e.no))
        case ir.Within():
            return replace(e, operand=again(e.operand), low=again(e.low), high=again(e.high))
        case ir.Element():
            return replace(e, array=again(e.array), index=again(e.index))
        case ir.Slice():
            return replace(e, array=again(e.array))
        case ir.Window():
            return replace(e, array=again(e.array), center=again(e.center))
        case ir.Call():
            return replace(e, arguments=tuple(again(x) for x in e.arguments))
        case ir.Reduce():
            condition = None if e.condition is None else again(e.condition)
            return replace(e, body=again(e.body), condition=condition)
        case ir.MemoryCall():
            return replace(e, arguments=tuple(again(x) for x in e.arguments), cell=e.cell + shift)
        case _:
            return e
