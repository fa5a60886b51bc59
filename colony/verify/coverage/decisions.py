"""The conditions of decisions, by masking MC/DC (Chilenski, 2001).

A decision is a bool made of conditions by `and`, `or`, `not`, `implies` and `if`. A condition decides it in a
frame in which the others do not mask it: a sibling in a conjunction is true, in a disjunction false, and the
branches of an `if` differ, or the `if` chooses its branch. A condition is covered by two frames in which it
decides, with the opposite value and the opposite outcome. The other conditions may differ.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

from colony.ir import expression as ir
from colony.ir.expression import Binary, Expression, rebuilt
from colony.ir.types import BOOL, Bool
from colony.verify.claims import TRUE, all_of, any_of, binary, negation, present

_JUNCTIONS = (Binary.AND, Binary.OR, Binary.IMPLIES)


class AtomicCondition(NamedTuple):
    """An atomic condition of a decision.

    Attributes:
        atom: the condition as written.
        value: what it reads as in the instrumented program.
        unmasked: the condition that the others do not mask it.
        signs: outcomes of the decision that the condition can have by being true.
    """

    atom: Expression
    value: Expression
    unmasked: Expression
    signs: tuple[bool, ...]


class AtomicDecision(NamedTuple):
    """A decision whose conditions have names: `outcome` reads the `lets` by name."""

    outcome: Expression
    lets: tuple[tuple[str, Expression], ...]
    conditions: tuple[AtomicCondition, ...]


def is_composed(e: Expression) -> bool:
    """Return True for a bool with operands that are bools and stand in the text: no condition, a decision."""
    match e:
        case ir.UnaryOperation(operand=operand) if not operand.span.source.text:
            return False  # `broken(A)`
        case ir.UnaryOperation(operator=ir.Unary.NOT) | ir.Conditional():
            return isinstance(e.type, Bool)
        case ir.BinaryOperation(operator=operator):
            return operator in _JUNCTIONS and isinstance(e.type, Bool)
        case _:
            return False


def decision(e: Expression, name: Callable[[int], str], *, in_module: bool) -> AtomicDecision:
    """Return a decision with a let for each condition.

    Args:
        e: the decision as written.
        name: the name of the let of a condition, by its number.
        in_module: True for lets of a module, which are all missing in the same frames; lets of a file are
            made so here, for memory moves on only in frames with all that the decision reads.
    """
    atoms: list[Expression] = []
    make = ir.LocalValue if in_module else ir.DerivedValue

    def named(part: Expression) -> Expression:
        if is_composed(part):
            return rebuilt(part, named)
        if isinstance(part, ir.Constant):
            return part
        atoms.append(part)
        return make(type=BOOL, name=name(len(atoms) - 1), span=part.span)

    outcome = named(e)
    needed = [] if in_module else [*dict.fromkeys(present(x) for atom in atoms for x in _needed(atom))]
    lets = tuple(
        (name(i), all_of((atom, any_of((TRUE, *needed)))) if len(atoms) > 1 and needed else atom)
        for i, atom in enumerate(atoms)
    )
    by_name = {let: atom for (let, _), atom in zip(lets, atoms, strict=True)}
    conditions = tuple(
        AtomicCondition(by_name[value.name], value, all_of(masks), signs)
        for value, masks, signs in _conditions(outcome, (), (True,))
    )
    return AtomicDecision(outcome, lets, conditions)


_Found = tuple[ir.LocalValue | ir.DerivedValue, tuple[Expression, ...], tuple[bool, ...]]


def _conditions(e: Expression, masks: tuple[Expression, ...], signs: tuple[bool, ...]) -> Iterator[_Found]:
    """Yield the conditions of a decision with named conditions, in the order written."""
    opposite = tuple(not s for s in signs)
    match e:
        case ir.LocalValue() | ir.DerivedValue():
            yield e, masks, signs
        case ir.UnaryOperation(operand=operand):
            yield from _conditions(operand, masks, opposite)
        case ir.BinaryOperation(operator=Binary.AND, left=left, right=right):
            yield from _conditions(left, (*masks, right), signs)
            yield from _conditions(right, (*masks, left), signs)
        case ir.BinaryOperation(operator=Binary.OR, left=left, right=right):
            yield from _conditions(left, (*masks, negation(right)), signs)
            yield from _conditions(right, (*masks, negation(left)), signs)
        case ir.BinaryOperation(operator=Binary.IMPLIES, left=left, right=right):
            yield from _conditions(left, (*masks, negation(right)), opposite)
            yield from _conditions(right, (*masks, left), signs)
        case ir.Conditional(condition=condition, yes=yes, no=no):
            differ = binary(Binary.NOT_EQUAL, yes, no)
            yield from _conditions(condition, (*masks, differ), (True, False))
            yield from _conditions(yes, (*masks, condition), signs)
            yield from _conditions(no, (*masks, negation(condition)), signs)
        case _:
            pass


def _needed(e: Expression) -> Iterator[Expression]:
    """Yield the sensors and the lets without which an expression is missing."""
    match e:
        case ir.SensorValue() | ir.DerivedValue():
            yield e
        case ir.ValueOr(other=other):
            yield from _needed(other)
        case _:
            for child in ir.children(e):
                yield from _needed(child)
