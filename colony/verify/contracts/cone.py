"""The cone of influence of a contract: what is proved about the cone holds for the whole system.

Nothing outside the cone can make the contract true or false: definitions give each auxiliary constant a
value, whatever the values of the others, and sensors are independent of each other.
"""

from __future__ import annotations

import z3

from colony.verify.symbolic import cones
from colony.verify.symbolic.cones import Cone
from colony.verify.symbolic.system import Claim, Number, Scalar, System


def cone_of(system: System, *claims: Claim) -> Cone:
    """Return the cone of contracts; time is in every cone."""
    return cones.cone(system, [*(c.holds for c in claims), system.now, system.begun, system.last])


def covers(cone: Cone, other: Cone) -> bool:
    """Return True if `other` depends on nothing outside `cone`."""
    return other.leaves <= cone.leaves


def within(cone: Cone, term: z3.ExprRef) -> bool:
    """Return True if a term is part of a cone."""
    return term.get_id() in cone.visited


def facts(cone: Cone) -> z3.BoolRef:
    """Return all that holds for a frame of a run as one formula, which is faster to rename."""
    return z3.And(*cone.assumptions, *cone.definitions, *cone.invariants)


def formulas_of(scalar: Scalar) -> tuple[z3.ExprRef, ...]:
    """Return the formulas that make up a value."""
    if isinstance(scalar, Number):
        return (scalar.value, scalar.nan, scalar.infinite)
    return (scalar,)
