"""Contracts `in time`: they are about frames in which no client of their actuators is late or lost.

A run in which one is late cannot break such a contract in that frame. If the contract remembers what its
actuators were given, nothing is known of it in later frames either, until memory is initial again.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from colony.ir.expression import (
    Expression,
    IsCommanded,
    IsIdle,
    MemoryCall,
    SentField,
    WonBy,
    subexpressions,
)
from colony.ir.frame import Given
from colony.ir.program import Contract, Robot


@dataclass(frozen=True, slots=True, kw_only=True)
class InTime:
    """The actuators that a contract `in time` names; `remembers` if it depends on their earlier frames."""

    actuators: tuple[str, ...]
    remembers: bool

    def excuses(self, now: Collection[str], before: Collection[str]) -> bool:
        """Return True if a frame cannot break the contract.

        Args:
            now: actuators that are idle in the frame because a client is late or lost.
            before: those that were since memory was initial.
        """
        return any(a in now or (self.remembers and a in before) for a in self.actuators)


def in_time(robot: Robot, contract: Contract) -> InTime | None:
    """Return the actuators of a contract `in time`; None for another contract."""
    if not contract.in_time:
        return None
    holding = {a.name for a in robot.actuators if a.idle is None}
    remembers = any(
        (isinstance(x, MemoryCall) and actuators_named(x))
        or (isinstance(x, SentField) and x.actuator in holding)
        for x in subexpressions(contract.expression)
    )
    return InTime(actuators=actuators_named(contract.expression), remembers=remembers)


def remembered(rules: Iterable[InTime | None]) -> frozenset[str]:
    """Return the actuators whose earlier frames matter to contracts `in time`."""
    return frozenset(a for rule in rules if rule is not None and rule.remembers for a in rule.actuators)


def actuators_named(expression: Expression) -> tuple[str, ...]:
    """Return the actuators of which an expression reads what they were given, in the order written."""
    kinds = (SentField, WonBy, IsCommanded, IsIdle)
    return tuple(dict.fromkeys(x.actuator for x in subexpressions(expression) if isinstance(x, kinds)))


def idled(given: Mapping[str, Given]) -> set[str]:
    """Return the actuators that are idle whatever the network decided."""
    return {actuator for actuator, what in given.items() if what.values is None}
