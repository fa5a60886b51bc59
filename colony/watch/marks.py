"""Moments of a run that a page can jump to, and that its timeline shows."""

from __future__ import annotations

from enum import IntFlag

from colony.watch.snapshot import Snapshot


class Mark(IntFlag):
    """What begins with a frame."""

    NOTHING = 0
    WINNER = 1
    """Another module, or none, commands an actuator."""
    BREACH = 2
    """A contract breaks."""
    FAULT = 4
    """A winner's command cannot be sent, or a sensor has a faulty value."""
    LATE = 8
    """A client is late, lost or refused, or a server is down."""
    OUTSIDE = 16
    """A connection outside the network commands, a lock holds, or an emergency stop begins."""
    RESTART = 32
    """All memory restarts."""


def mark_of(before: Snapshot | None, now: Snapshot) -> Mark:
    """Return what begins with a frame; `before` is the frame before it, None for the first."""
    if before is None:
        return Mark.NOTHING
    pairs = tuple(zip(before.commands, now.commands, strict=True))
    mark = Mark.NOTHING
    if any(a.by != b.by for a, b in pairs):
        mark |= Mark.WINNER
    contracts = zip(before.contracts, now.contracts, strict=True)
    if any(b == "broken" and a != "broken" for a, b in contracts):
        mark |= Mark.BREACH
    if any(b.fault is not None and a.fault != b.fault for a, b in pairs) or set(now.stale) - set(
        before.stale
    ):
        mark |= Mark.FAULT
    if set(now.late) - set(before.late):
        mark |= Mark.LATE
    begins = any((a.outside, a.hold) != (b.outside, b.hold) and (b.outside or b.hold) for a, b in pairs)
    if begins or (now.stopped_by is not None and before.stopped_by is None):
        mark |= Mark.OUTSIDE
    if now.is_restart:
        mark |= Mark.RESTART
    return mark
