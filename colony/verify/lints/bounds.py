"""The bounds of a field in a frame as expressions, so that claims can compare them.

Each bound and condition of a limit becomes a let of the instrumented program, which the limit reads in its
place: its memory exists once, and claims can read it too.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from colony.ir import expression as ir
from colony.ir.expression import Binary, Expression
from colony.ir.program import Actuator, ActuatorField, Let, Limit, Program
from colony.ir.types import BOOL
from colony.verify.claims import FALSE, TRUE, all_of, any_of, binary, constant, implies, negation, value_or


@dataclass(frozen=True, slots=True, kw_only=True)
class Bound:
    """A bound of a field: of a limit, or of the range if `limit` is None.

    Attributes:
        is_upper: True for an upper bound.
        applies: The condition that it applies.
        known: The condition that it has a value. Only on `idle hold` may it have none where it applies.
        value: The bound in base units; the idle command's value where the limit's is missing or not finite.
        constant: The value, if it is constant.
        limit: The limit.
    """

    is_upper: bool
    applies: Expression = TRUE
    known: Expression = TRUE
    value: Expression
    constant: float | None
    limit: Limit | None = None


def with_named_bounds(program: Program) -> Program:
    """Return the program with a let for each bound and condition of a limit, which the limit reads."""
    lets: list[Let] = []
    limits = []
    for i, limit in enumerate(program.limits):
        bound, condition = limit.bound, limit.condition
        if not isinstance(bound, ir.Constant):
            lets.append(Let(name=_bound_name(i), expression=bound))
            bound = ir.DerivedValue(type=bound.type, name=_bound_name(i))
        if condition is not None:
            lets.append(Let(name=_condition_name(i), expression=condition))
            condition = ir.DerivedValue(type=BOOL, name=_condition_name(i))
        limits.append(replace(limit, bound=bound, condition=condition))
    return replace(program, derived=(*program.derived, *lets), limits=tuple(limits))


def _bound_name(i: int) -> str:
    """Return the name of the let for the bound of a limit; names of the language have no blanks."""
    return f"limit {i}"


def _condition_name(i: int) -> str:
    return f"limit {i} when"


def all_bounds(program: Program, actuator: Actuator, i: int) -> tuple[Bound, ...]:
    """Return the bounds of field `i` of an actuator: of its range, then of its limits as written."""
    of_limits = (
        _of_limit(limit, number, actuator)
        for number, limit in enumerate(program.limits)
        if limit.actuator == actuator.name and limit.field_index == i
    )
    return (*_of_range(actuator.fields[i]), *of_limits)


def _of_range(field: ActuatorField) -> Iterator[Bound]:
    for value, is_upper in ((field.low, False), (field.high, True)):
        if value is not None:
            yield Bound(is_upper=is_upper, value=constant(value, field.type), constant=value)


def _of_limit(limit: Limit, number: int, actuator: Actuator) -> Bound:
    is_upper = limit.relation == "<="
    applies: Expression = TRUE
    if limit.condition is not None:
        asked = ir.DerivedValue(type=BOOL, name=_condition_name(number))
        applies = value_or(asked, TRUE)
    if isinstance(limit.bound, ir.Constant):
        known_value = float(limit.bound.value)  # type: ignore[arg-type]  # a limit bounds a scalar
        return Bound(is_upper=is_upper, applies=applies, value=limit.bound, constant=known_value, limit=limit)
    name = _bound_name(number)
    if applies is not TRUE:
        applies = any_of((negation(ir.Fresh(type=BOOL, name=name, derived=True)), applies))
    computed: Expression = ir.DerivedValue(type=limit.bound.type, name=name)
    known = value_or(is_finite(computed), FALSE)
    idle_value = 0.0 if actuator.idle is None else actuator.idle[limit.field_index]
    idle = constant(idle_value, actuator.fields[limit.field_index].type)
    finite = ir.Conditional(type=computed.type, condition=is_finite(computed), yes=computed, no=idle)
    value = value_or(finite, idle)
    return Bound(
        is_upper=is_upper,
        applies=applies,
        known=known if actuator.idle is None else TRUE,
        value=value,
        constant=None,
        limit=limit,
    )


def is_finite(e: Expression) -> Expression:
    """Return the condition that a number is neither infinite nor NaN."""
    low, high = (constant(x, e.type) for x in (-sys.float_info.max, sys.float_info.max))  # type: ignore[arg-type]
    return ir.Within(type=BOOL, operand=e, low=low, high=high)


def contradiction(bounds: Sequence[Bound]) -> Expression:
    """Return the condition that a lower bound is above an upper one; the constant false if it cannot be."""
    found = []
    for low in bounds:
        for high in bounds:
            if low.is_upper or not high.is_upper or _agree(low, high):
                continue
            exceeds = binary(Binary.GREATER, low.value, high.value)
            found.append(all_of(x for x in (low.applies, high.applies, exceeds) if x is not TRUE))
    return any_of(found)


def _agree(low: Bound, high: Bound) -> bool:
    """Return True if a lower and an upper bound are constants that do not contradict each other."""
    if low.limit is None and high.limit is None:
        return True
    return low.constant is not None and high.constant is not None and low.constant <= high.constant


def exclusion(bounds: Sequence[Bound], idle: float, field: ActuatorField) -> Expression:
    """Return the condition that a limit excludes the idle command's value; the constant false if none can."""
    found = []
    for bound in bounds:
        if bound.limit is None or (bound.constant is not None and _allows(bound, idle)):
            continue
        operator = Binary.LESS if bound.is_upper else Binary.GREATER
        excludes = binary(operator, bound.value, constant(idle, field.type))
        found.append(all_of(x for x in (bound.applies, excludes) if x is not TRUE))
    return any_of(found)


def _allows(bound: Bound, idle: float) -> bool:
    assert bound.constant is not None
    return idle <= bound.constant if bound.is_upper else idle >= bound.constant


def all_known(bounds: Sequence[Bound]) -> Expression:
    """Return the condition that every bound that applies has a value."""
    return all_of(
        b.known if b.applies is TRUE else implies(b.applies, b.known) for b in bounds if b.known is not TRUE
    )
