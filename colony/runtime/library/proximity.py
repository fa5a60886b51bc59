"""Calls of PServer: read both rings of sensors, and set the range of the sonars (thesis section 4.6.2).

Sensors are numbered counterclockwise: 12 faces forward, 18 left, 0 backward, 6 right.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import NoArguments


class SonarReading(msgspec.Struct, frozen=True, kw_only=True):
    """The range of each sonar in mm, measured at `t_ns`."""

    t_ns: int
    ranges: tuple[float, ...]


class InfraredReading(msgspec.Struct, frozen=True, kw_only=True):
    """A flag for each detector, True if it saw something at `t_ns`; False if it is not connected."""

    t_ns: int
    seen: tuple[bool, ...]


class SetTimeouts(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `set_timeouts`: the maximum range of each of the sonars in mm."""

    ranges: tuple[float, ...]


def sonar() -> CallRequest[SonarReading | None]:
    """Read the newest ranges; None while the device has none (`PROX_SONAR`)."""
    return CallRequest("sonar", NoArguments(), SonarReading | None, "read", repeatable=True)


def infrared() -> CallRequest[InfraredReading | None]:
    """Read the infrared detectors; None while the device has no values (`PROX_IR`)."""
    return CallRequest("infrared", NoArguments(), InfraredReading | None, "read", repeatable=True)


def set_timeouts(ranges: Sequence[float]) -> CallRequest[None]:
    """Set the maximum range of each of the sonars in mm (`PROX_TIMEOUT`).

    A sonar reads its maximum range if nothing is nearer. The setting applies to all connections, until
    PServer ends.
    """
    return CallRequest(
        "set_timeouts", SetTimeouts(ranges=tuple(ranges)), type(None), "command", repeatable=True
    )


def timeouts() -> CallRequest[tuple[float, ...] | None]:
    """Read the ranges set last by `set_timeouts`; None if unset, as then the sonars use their full range."""
    return CallRequest("timeouts", NoArguments(), tuple[float, ...] | None, "read", repeatable=True)
