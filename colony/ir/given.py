"""What an actuator was given in a frame, read from the outcome that was published or recorded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

from colony.ir.frame import Given
from colony.ir.program import Actuator, in_base_units
from colony.ir.types import ScalarValue


class SentCommand(Protocol):
    """The outcome of one actuator in one frame; `runtime.messages.Verdict` defines each attribute."""

    @property
    def by(self) -> str | None:
        """The module that won, if any."""
        ...

    @property
    def values(self) -> tuple[ScalarValue, ...] | None:
        """The command that was sent, in declared units, None if nothing was."""
        ...

    @property
    def fault(self) -> str | None:
        """The reason why the idle command was sent instead, if any."""
        ...

    @property
    def fates(self) -> Sequence[tuple[str, str]]:
        """Each client and its fate, then those of connections from outside that commanded in vain."""
        ...

    @property
    def outside(self) -> str | None:
        """The client outside the network that acted, if any."""
        ...

    @property
    def hold(self) -> str | None:
        """The reason why the network did not decide, if any."""
        ...

    @property
    def violation(self) -> bool:
        """True if two clients commanded in one frame."""
        ...

    @property
    def unlimited(self) -> bool:
        """True if the limits did not hold for the client outside the network."""
        ...


MISSED = frozenset({"late", "lost", "refused"})
"""Fates of clients whose requests did not count, so that the actuator may have been idle."""


def is_connection(party: str) -> bool:
    """Return True if a party that has a fate is a connection from outside (`user/id`), not a client."""
    return "/" in party


def given_in_frame(actuators: Iterable[Actuator], outcomes: Mapping[str, SentCommand]) -> dict[str, Given]:
    """Return what actuators were given where that may not be what the network decided.

    That is the command of a connection from outside; or nothing, if the actuator was idle because the command
    of that connection could not be sent, because of a stop or a lock, or because a client was not heard.
    """
    return {
        actuator.name: Given(_values_outside(actuator, outcome))
        for actuator in actuators
        if (outcome := outcomes.get(actuator.name)) is not None and not _is_the_networks(outcome)
    }


def value_sent(value: ScalarValue, factor: float, low: float | None, high: float | None) -> ScalarValue:
    """Return what was sent to a field, in base units, given what it reads back as.

    Outcomes are in declared units, and the conversion there and back rounds: 30 deg/s reads back as
    29.999999999999996 deg/s from a field in rad/s. A value that is beyond a bound of its frame, but is what
    that bound reads back as, was the bound.
    """
    if low is not None and value < low and low / factor * factor == value:
        return low
    if high is not None and value > high and high / factor * factor == value:
        return high
    return value


def _is_the_networks(outcome: SentCommand) -> bool:
    if outcome.by is not None:
        return True
    undisturbed = outcome.outside is None and outcome.hold is None
    return undisturbed and not any(fate in MISSED for _, fate in outcome.fates)


def _values_outside(actuator: Actuator, outcome: SentCommand) -> tuple[ScalarValue, ...] | None:
    if outcome.outside is None or outcome.fault is not None or outcome.values is None:
        return None
    return in_base_units(outcome.values, actuator.fields)
