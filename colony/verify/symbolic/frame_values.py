"""The values that expressions of a frame may read, as terms."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass, field

import z3

from colony.ir import expression as ir
from colony.verify.symbolic.logic import FALSE, any_of, both, negation
from colony.verify.symbolic.system import Scalar, Term


@dataclass(frozen=False, slots=True, kw_only=True)
class FrameValues:
    """The values of one frame. Mutable: filled in the order in which a frame is computed.

    A value has a term even where it is missing; there the term is arbitrary.
    """

    now: z3.ArithRef
    begun: z3.BoolRef  # there was an earlier frame
    last: z3.ArithRef  # time of the previous frame
    restarted: z3.BoolRef  # memory was lost before this frame
    sensors: dict[str, Term] = field(default_factory=dict)
    present: dict[str, z3.BoolRef] = field(default_factory=dict)  # sensors with a reading
    missing: dict[str, z3.BoolRef] = field(default_factory=dict)  # sensors with neither value nor default
    derived: dict[str, tuple[z3.BoolRef, Term]] = field(default_factory=dict)  # missing, value
    states: dict[str, Scalar] = field(default_factory=dict)
    locals: dict[str, tuple[z3.BoolRef, Term]] = field(default_factory=dict)  # missing, value
    active: dict[str, z3.BoolRef] = field(default_factory=dict)
    wins: dict[str, dict[str, z3.BoolRef]] = field(default_factory=dict)  # by actuator and module
    commanded: dict[str, z3.BoolRef] = field(default_factory=dict)
    sent: dict[tuple[str, int], tuple[z3.BoolRef, Scalar]] = field(default_factory=dict)  # missing, value


def missing(e: ir.Expression, frame_values: FrameValues, own_lets: Set[str] = frozenset()) -> z3.BoolRef:
    """Return the condition that something `e` needs is missing; `own_lets` count as present."""
    match e:
        case ir.SensorValue(name=name):
            return frame_values.missing[name]
        case ir.DerivedValue(name=name):
            return frame_values.derived[name][0]
        case ir.LocalValue(name=name):
            return FALSE if name in own_lets else frame_values.locals[name][0]
        case ir.SentField(actuator=actuator, field_index=i):
            return frame_values.sent[actuator, i][0]
        case ir.ValueOr(other=other):
            return missing(other, frame_values, own_lets)
        case _:
            return any_of(missing(child, frame_values, own_lets) for child in ir.children(e))


def evaluation_condition(
    condition: z3.BoolRef, e: ir.Expression, frame_values: FrameValues, own_lets: Set[str]
) -> z3.BoolRef:
    """Return the condition under which `e` is evaluated: `condition`, and nothing it needs is missing."""
    return both(condition, negation(missing(e, frame_values, own_lets)))
