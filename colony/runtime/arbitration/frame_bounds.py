"""The bounds of an actuator in a frame, to which a command from outside the network is held.

The client `BOUNDS` sends them, computed from the same frame as the program's own commands. A command of frame
k from outside the network obeys the bounds of frame k: where they do not arrive by the deadline, where they
are malformed, or where no command satisfies them, the actuator gets its idle command, which is never bounded.
The program's own commands do not wait for these bounds: its clients bound them themselves.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import NamedTuple

from colony.execute.needs import BOUNDS
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.ballot import OutsideCommand
from colony.runtime.protocol.deployment import ActuatorFieldSpec, ActuatorSpec
from colony.runtime.protocol.messages import Bounds, Fate

LIMITS_UNKNOWN = "limits unknown"
"""Fault of an outside command in a frame whose bounds did not arrive by the deadline."""


class BoundedCommand(NamedTuple):
    """An outside command as it is sent.

    `values` are in base units. With a `fault` they are those of the idle command, None if nothing is sent;
    `note` tells users the reason.
    """

    values: tuple[ScalarValue, ...] | None
    fault: str | None = None
    note: str | None = None


class FrameBounds:
    """The bounds of one actuator, of this frame and later ones. Stateful.

    Args:
        actuator: actuator; unless it is `limited`, every command may be sent.
        frames_ahead: maximum number of frames whose bounds are kept before their ticks.
    """

    def __init__(self, actuator: ActuatorSpec, frames_ahead: int) -> None:
        self._actuator = actuator
        self._frames_ahead = frames_ahead
        self._k = -1
        self._ahead: dict[int, Bounds] = {}
        self._bounds: Bounds | None = None
        self._failed: Fate | None = None

    def begin(self, k: int, *, lost: bool) -> None:
        """Begin frame `k`; `lost` is True if the client of the bounds is lost."""
        self._k = k
        self._bounds = self._ahead.pop(k, None) if self._ahead else None
        self._failed = "lost" if lost else None
        if self._ahead:
            self._ahead = {later: v for later, v in self._ahead.items() if later > k}

    def take(self, bounds: Bounds) -> str | None:
        """Take the bounds of this frame or a later one; return a note if they are refused.

        The first bounds of a frame count. Bounds of earlier frames are ignored.
        """
        if not self._actuator.limited or bounds.k < self._k:
            return None
        reason = bounds_error(bounds, self._actuator)
        if reason is not None:
            if bounds.k == self._k and self._bounds is None:
                self._failed = "refused"
            return reason
        if bounds.k == self._k:
            self._bounds = self._bounds or bounds
        elif may_keep(bounds.k, self._ahead, self._k, self._frames_ahead):
            self._ahead.setdefault(bounds.k, bounds)
        return None

    def awaited_for(self, command: OutsideCommand) -> bool:
        """Return True if a command needs the bounds of the frame, and these may still arrive."""
        return self._binds(command) and self._bounds is None and self._failed is None

    def apply(self, command: OutsideCommand) -> BoundedCommand:
        """Return a command held to the bounds of the frame, field by field."""
        if not self._binds(command):
            return BoundedCommand(command.values)
        idle, bounds = self._actuator.idle, self._bounds
        if bounds is None:
            reason = (
                "have not come" if self._failed is None else f"are not known: `{BOUNDS}` is {self._failed}"
            )
            return BoundedCommand(idle, LIMITS_UNKNOWN, f"limits of frame {self._k} {reason}")
        if bounds.fault is not None:
            return BoundedCommand(idle, bounds.fault, f"limits of frame {self._k}: {bounds.fault}")
        limits = zip(command.values, bounds.low, bounds.high, strict=True)
        return BoundedCommand(tuple([_clamp(value, low, high) for value, low, high in limits]))

    def fates(self, fault: str | None) -> tuple[tuple[str, Fate], ...]:
        """Return the fate of the client of the bounds in a frame whose command waited for it in vain."""
        return ((BOUNDS, self._failed or "late"),) if fault == LIMITS_UNKNOWN else ()

    def _binds(self, command: OutsideCommand) -> bool:
        return self._actuator.limited and not command.unlimited


def may_keep(later: int, kept: Collection[int], k: int, frames_ahead: int) -> bool:
    """Return True if a message that precedes its tick may be kept.

    Args:
        later: frame of the message.
        kept: frames of which messages are kept already.
        k: present frame, -1 before the first tick, which may have any number.
        frames_ahead: maximum number of frames by which a message may precede its tick.
    """
    if k >= 0:
        return later <= k + frames_ahead
    return later in kept or len(kept) < frames_ahead


def bounds_error(bounds: Bounds, actuator: ActuatorSpec) -> str | None:
    """Return the reason why bounds are malformed, or None. No malformed bounds may move a robot."""
    if bounds.fault is not None:
        return None
    count = len(actuator.fields)
    if len(bounds.low) != count or len(bounds.high) != count:
        found = f"{len(bounds.low)} lower and {len(bounds.high)} upper ones"
        return f"bounds of {actuator.name}: {found}; expected {count} of each"
    for field, low, high in zip(actuator.fields, bounds.low, bounds.high, strict=True):
        if not _is_interval(field, low, high):
            return f"bounds of {actuator.name}: {field.name} from {low!r} to {high!r}"
    return None


def _is_interval(field: ActuatorFieldSpec, low: float | None, high: float | None) -> bool:
    """Return True if these are the bounds of a field: within its range, and the lower not above the upper."""
    given = tuple(bound for bound in (low, high) if bound is not None)
    if field.kind == "bool":
        return not given
    if not all(map(math.isfinite, given)) or (len(given) == 2 and given[0] > given[1]):
        return False
    return (field.low is None or (low is not None and low >= field.low)) and (
        field.high is None or (high is not None and high <= field.high)
    )


def _clamp(value: ScalarValue, low: float | None, high: float | None) -> ScalarValue:
    if low is not None and value < low:
        return low
    return high if high is not None and value > high else value
