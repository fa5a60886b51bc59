"""Whether a message can be true now. One that cannot is malformed: it costs itself alone.

Frames are numbered by the Clock, a number each `NUMBER_NS` of the robot's time at most (see `clock.py`). So
no frame that exists has a higher number than the time allows; a server that believed in one would wait for
the robot's Clock to get there for as long as it takes.
"""

from __future__ import annotations

from colony.runtime.codec import NotAMessage
from colony.runtime.messages import (
    Announcement,
    Checkpoint,
    Fetch,
    Ready,
    Request,
    Restart,
    Sent,
    ServerFrame,
    Stopped,
    Tick,
    Verdict,
)

NUMBER_NS = 100_000
"""The shortest frame: a number's worth of the robot's time."""

AHEAD_NS = 1_000_000_000
"""By how much the clock of a sender may be ahead of ours."""

LONGEST_NAME = 600
"""Characters of an address: of an actuator and a module, or of a server and what it relays."""

MOST_NAMES = 10_000
"""Servers, clients or void frames of which a tick tells."""


def check_plausible(message: Sent, now_ns: int) -> None:
    """Check numbers of frames, times and names against what is possible at `now_ns` of the robot.

    Raises:
        NotAMessage: the message cannot be true.
    """
    match message:
        case Tick():
            _check_tick(message, now_ns)
        case ServerFrame(k=k, server=server, since=since, stopped=stopped):
            _check_number(k, now_ns)
            _check_number(since, now_ns)
            _check_name(server)
            _check_stop(stopped, now_ns)
        case Request(k=k, client=client) | Ready(k=k, client=client) | Checkpoint(k=k, client=client):
            _check_number(k, now_ns)
            _check_name(client)
        case Announcement(k=k, module=name) | Fetch(k=k, server=name) | Verdict(k=k, actuator=name):
            _check_number(k, now_ns)
            _check_name(name)
        case Restart(start=start, client=client):
            _check_number(start, now_ns)
            _check_name(client)
        case _:
            pass


def _check_tick(tick: Tick, now_ns: int) -> None:
    _check_number(tick.k, now_ns)
    if not 0 <= tick.start <= tick.k:
        raise NotAMessage(f"frame {tick.k} of an epoch that began at {tick.start}")
    if max(len(tick.down), len(tick.lost), len(tick.void)) > MOST_NAMES:
        raise NotAMessage(f"more than {MOST_NAMES} servers or clients in a tick")
    if tick.released_ns > now_ns + AHEAD_NS:
        raise NotAMessage(f"a release at {tick.released_ns} ns, and it is {now_ns}")
    _check_stop(tick.stopped, now_ns)


def _check_stop(stopped: Stopped | None, now_ns: int) -> None:
    if stopped is not None and stopped.t_ns > now_ns + AHEAD_NS:
        raise NotAMessage(f"an emergency stop at {stopped.t_ns} ns, and it is {now_ns}")


def _check_number(k: int, now_ns: int) -> None:
    """-1 stands for no frame."""
    if not -1 <= k <= (now_ns + AHEAD_NS) // NUMBER_NS:
        raise NotAMessage(f"frame {k} cannot be yet")


def _check_name(name: str) -> None:
    if len(name) > LONGEST_NAME:
        raise NotAMessage(f"the name `{name[:20]}...` has {len(name)} characters")
