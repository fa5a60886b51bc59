"""Plausibility checks of messages against the robot's time.

An implausible message counts as malformed, and has no other effect. The Clock numbers at most one frame for
each `FRAME_NUMBER_NS` of the robot's time (see `clock.py`), so the time limits frame numbers. A server that
accepted a higher one would ignore all ticks until the Clock reaches it.
"""

from __future__ import annotations

from colony.runtime.protocol.codec import MessageFormatError
from colony.runtime.protocol.messages import (
    Announcement,
    Bounds,
    Checkpoint,
    Fetch,
    Progress,
    Ready,
    Request,
    Restart,
    SentMessage,
    ServerFrame,
    Stopped,
    Tick,
    Verdict,
)

FRAME_NUMBER_NS = 100_000
"""Nanoseconds of the robot's time for each frame number, and thus the shortest frame."""

MAX_CLOCK_LEAD_NS = 1_000_000_000
"""Nanoseconds by which a sender's clock may be ahead of this process's clock."""

MAX_ADDRESS_LENGTH = 600
"""Maximum number of characters of an address.

An address has two names of up to 255 characters each: an actuator and a module, or a server and a module
whose activity it relays.
"""

MAX_NAMES = 10_000
"""Maximum number of servers in a tick; also of clients, and of void frames."""

MAX_GAPS = 20
"""Maximum number of gaps in a tick."""


def check_plausible(message: SentMessage, now_ns: int) -> None:
    """Check frame numbers, times and names against what is possible at the robot's time `now_ns`.

    Raises:
        MessageFormatError: the message is implausible.
    """
    match message:
        case Tick():
            _check_tick(message, now_ns)
        case ServerFrame(k=k, server=server, since=since, stopped=stopped):
            _check_frame_number(k, now_ns)
            _check_frame_number(since, now_ns)
            _check_name(server)
            _check_stop(stopped, now_ns)
        case Ready(k=k, client=client, progress=progress):
            _check_frame_number(k, now_ns)
            _check_name(client)
            _check_progress(progress, now_ns)
        case Request(k=k, client=client) | Checkpoint(k=k, client=client):
            _check_frame_number(k, now_ns)
            _check_name(client)
        case (
            Announcement(k=k, module=name)
            | Fetch(k=k, server=name)
            | Verdict(k=k, actuator=name)
            | Bounds(k=k, actuator=name)
        ):
            _check_frame_number(k, now_ns)
            _check_name(name)
        case Restart(start=start, client=client):
            _check_frame_number(start, now_ns)
            _check_name(client)
        case _:
            pass


def _check_tick(tick: Tick, now_ns: int) -> None:
    _check_frame_number(tick.k, now_ns)
    if not 0 <= tick.start <= tick.k:
        raise MessageFormatError(f"frame {tick.k} of an epoch that began at {tick.start}")
    if max(len(tick.down), len(tick.lost), len(tick.void)) > MAX_NAMES:
        raise MessageFormatError(f"more than {MAX_NAMES} servers or clients in a tick")
    least = tick.start
    for previous, first in tick.gaps[:MAX_GAPS]:
        if not least <= previous < first <= tick.k:
            raise MessageFormatError(f"a gap from {previous} to {first} in the tick of frame {tick.k}")
        least = first
    if len(tick.gaps) > MAX_GAPS:
        raise MessageFormatError(f"more than {MAX_GAPS} gaps in a tick")
    if tick.released_ns > now_ns + MAX_CLOCK_LEAD_NS:
        raise MessageFormatError(f"a release at {tick.released_ns} ns, but it is {now_ns} ns now")
    _check_stop(tick.stopped, now_ns)


def _check_progress(progress: Progress | None, now_ns: int) -> None:
    if progress is None:
        return
    _check_frame_number(progress.stepped, now_ns)
    if not 0 <= progress.start <= progress.stepped + 1:
        raise MessageFormatError(f"frame {progress.stepped} of an epoch that began at {progress.start}")
    for tick in progress.ticks:
        _check_tick(tick, now_ns)


def _check_stop(stopped: Stopped | None, now_ns: int) -> None:
    if stopped is not None and stopped.t_ns > now_ns + MAX_CLOCK_LEAD_NS:
        raise MessageFormatError(f"an emergency stop at {stopped.t_ns} ns, but it is {now_ns} ns now")


def _check_frame_number(k: int, now_ns: int) -> None:
    """Check a frame number; -1 stands for no frame."""
    if not -1 <= k <= (now_ns + MAX_CLOCK_LEAD_NS) // FRAME_NUMBER_NS:
        raise MessageFormatError(f"frame {k} is not possible yet")


def _check_name(name: str) -> None:
    if len(name) > MAX_ADDRESS_LENGTH:
        raise MessageFormatError(f"the name `{name[:20]}...` has {len(name)} characters")
