"""The command sent: the winner's command, limited and clamped, or the idle command."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import z3

from colony.ir import program as ir
from colony.ir.types import Bool
from colony.verify.symbolic.builder import Builder
from colony.verify.symbolic.cases import constant
from colony.verify.symbolic.expressions import Expressions, lifted
from colony.verify.symbolic.functions import number
from colony.verify.symbolic.logic import FALSE, TRUE, all_of, any_of, both, is_false, negation
from colony.verify.symbolic.moment import Moment, missing
from colony.verify.symbolic.numbers import compared, finite, greatest, least, negated, select, select_number
from colony.verify.symbolic.system import ActuatorTerms, Inexact, ModuleTerms, Number, Reason, Scalar


@dataclass(frozen=True, slots=True)
class Bound:
    """A limit in the frame: the condition that it applies, and its bound, which is finite."""

    limit: ir.Limit
    applies: z3.BoolRef
    bound: Number


def limits(program: ir.Program, builder: Builder, moment: Moment) -> list[Bound]:
    """Return all limits, in the order written."""
    found = []
    for limit in program.limits:
        hint = f"limit {limit.actuator}"
        absent = missing(limit.bound, moment)
        moved = Expressions(builder=builder, moment=moment, moves=negation(absent), hint=hint)
        value = number(moved.scalar(limit.bound))
        applies = TRUE
        if limit.condition is not None:
            unknown = missing(limit.condition, moment)
            asked = Expressions(builder=builder, moment=moment, moves=negation(unknown), hint=hint)
            applies = any_of((unknown, absent, asked.boolean(limit.condition)))
        standing = select_number(both(negation(absent), finite(value)), as_finite(value), constant(0.0))
        found.append(Bound(limit, applies, standing))
    return found


def as_finite(x: Number) -> Number:
    """Return `x`, assumed to be finite."""
    known = x.cases if all(math.isfinite(v) for v, _ in x.cases) else ()
    return replace(x, nan=FALSE, infinite=FALSE, cases=known)


def send(
    actuator: ir.Actuator,
    modules: Mapping[str, ModuleTerms],
    bounds: Sequence[Bound],
    builder: Builder,
    moment: Moment,
) -> ActuatorTerms:
    """Encode the command sent: the idle command if a field of the winner's command is not finite."""
    wins = {m: w for m, w in moment.wins[actuator.name].items() if not is_false(w)}
    commands = [modules[m].command for m in wins]
    fit = [
        both(w, all_of(finite(x) for x in command if isinstance(x, Number)))
        for w, command in zip(wins.values(), commands, strict=True)
    ]
    limited = []
    for i, field in enumerate(actuator.fields):
        own = [b for b in bounds if b.limit.actuator == actuator.name and b.limit.field_index == i]
        limited.append(_field(field, fit, [command[i] for command in commands], own))
    leaves = (_leaves(x, field, builder) for x, field in zip(limited, actuator.fields, strict=True))
    commanded = moment.commanded[actuator.name] = both(any_of(fit), all_of(leaves))
    sent = []
    for i, (field, x) in enumerate(zip(actuator.fields, limited, strict=True)):
        standing = x if actuator.idle is None else select(commanded, x, lifted(actuator.idle[i]))
        named = builder.named(standing, f"{actuator.name}.{field.name}")
        moment.sent[actuator.name, i] = (negation(commanded) if actuator.idle is None else FALSE, named)
        sent.append(named)
    return ActuatorTerms(wins=wins, commanded=commanded, sent=tuple(sent))


def _field(
    field: ir.ActuatorField, fit: Sequence[z3.BoolRef], values: Sequence[Scalar], bounds: Sequence[Bound]
) -> Scalar:
    """Return one field of the winner's command, taken to be finite, within limits and range."""
    if not values:
        return FALSE if isinstance(field.type, Bool) else constant(0.0)
    result = _plain(values[-1])
    for condition, value in zip(reversed(fit[:-1]), reversed(values[:-1]), strict=True):
        result = select(condition, _plain(value), result)
    return _bounded(result, field, bounds) if isinstance(result, Number) else result


def _plain(x: Scalar) -> Scalar:
    return as_finite(x) if isinstance(x, Number) else x


def _bounded(x: Number, field: ir.ActuatorField, bounds: Sequence[Bound]) -> Number:
    """Return a finite field within its limits, in the order written, then within the actuator's range."""
    for b in bounds:
        beyond = compared(b.bound, x, "<") if b.limit.relation == "<=" else compared(x, b.bound, "<")
        x = select_number(both(b.applies, beyond), b.bound, x)
    if field.low is not None:
        x = greatest((x, constant(field.low)))
    if field.high is not None:
        x = least((x, constant(field.high)))
    return x


def _leaves(x: Scalar, field: ir.ActuatorField, builder: Builder) -> z3.BoolRef:
    """Return the condition that a field is finite in its declared unit, in which it is sent."""
    if not isinstance(x, Number) or field.factor >= 1:
        return TRUE
    most = constant(sys.float_info.max * field.factor)
    leaves = both(compared(x, most, "<="), compared(negated(most), x, "<="))
    text = f"`{field.name}` may be too large for a float in {field.unit}"
    builder.mark_inexact(leaves, Reason(Inexact.ROUNDING, field.span, text))
    return leaves
