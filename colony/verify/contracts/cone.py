"""The cone of influence of a contract: a proof within it is a proof.

What lies outside of it cannot make the contract true or false: definitions give each auxiliary constant a
value whatever the rest is, and sensors are independent of each other.
"""

from __future__ import annotations

import z3

from colony.verify.symbolic.cones import Cone, cone
from colony.verify.symbolic.system import Claim, Number, Scalar, System


def cone_of(system: System, claim: Claim) -> Cone:
    """Return the cone of a contract; time is in every cone."""
    return cone(system, [claim.speaks, claim.holds, system.now, system.begun, system.last])


def covers(one: Cone, other: Cone) -> bool:
    """Return True if `other` depends on nothing besides what `one` depends on."""
    return _constants(other) <= _constants(one)


def key_of(one: Cone) -> frozenset[int]:
    """Return a key that identifies a cone within its system."""
    return _constants(one)


def _constants(one: Cone) -> frozenset[int]:
    return frozenset(c.get_id() for c in (*one.constants, *(cell.old for cell in one.cells)))


def within(one: Cone, term: z3.ExprRef) -> bool:
    """Return True if a term is part of a cone."""
    return term.get_id() in one.visited


def facts(one: Cone) -> z3.BoolRef:
    """Return all that is true of a frame in a run, as one formula, which is renamed at once."""
    return z3.And(*one.assumptions, *one.definitions, *one.invariants)


def parts(scalar: Scalar) -> tuple[z3.ExprRef, ...]:
    """Return the formulas that make up a value."""
    if isinstance(scalar, Number):
        return (scalar.value, scalar.nan, scalar.infinite)
    return (scalar,)
