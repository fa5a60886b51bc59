"""The gateway's limits: sizes, counts and timeouts of traffic between the robot and other machines.

A gateway never waits for a receiver. It drops messages for which a busy server or a slow user has no room,
and the protocol sends them again (a call after 250 ms, with the same number; a frame at the next tick).
Waiting would block all other users, and zenoh closes a link on which it waited in vain. For the same reason
users choose neither their priority nor what happens when there is no room: the key of a message decides.

Nothing here limits the rate of messages. Zenoh's `downsampling` allows no bursts: of simultaneous calls of
one user it would drop all but one, and drop them again when they are retried, again simultaneously. Servers
count messages instead (`rate_limits.py`).
"""

from __future__ import annotations

import resource
from typing import Any

from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.transport.live import keys

HANDSHAKE_MS = 2000
"""Timeout of a TLS handshake, in milliseconds; its connection is then closed."""

LOGIN_MS = 2000
"""Timeout of zenoh's login, in milliseconds. The login begins after TLS has accepted the certificate."""

MAX_PENDING_LOGINS = 100
"""Logins that the gateway handles at the same time."""

MAX_SESSIONS = 200
"""Sessions of users and of the robot's own processes together; a server of the robot has two."""

MAX_OPEN_FILES = 8192
"""Open files allowed to a gateway, as far as the system permits.

This is far more than the connections that can wait for their handshake timeout.
"""

SMALL_MESSAGE_BYTES, MEDIUM_MESSAGE_BYTES = 1024, 257 * 1024
"""Size limits, in bytes, of two kinds of messages; see `_sizes`."""

_REMOTE = ["tls"]


def limits(robot: str) -> dict[str, Any]:
    """Return the settings of a gateway that limit what passes through it."""
    return {
        "transport/unicast/accept_timeout": LOGIN_MS,
        "transport/unicast/accept_pending": MAX_PENDING_LOGINS,
        "transport/unicast/max_sessions": MAX_SESSIONS,
        "transport/link/tx/queue/size": _QUEUES,
        "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 200_000,
        "low_pass_filter": list(_sizes(robot)),
        "qos/network": list(_urgency(robot)),
    }


_QUEUES = {
    "control": 2,
    "real_time": 2,
    "interactive_high": 4,
    "interactive_low": 2,
    "data_high": 2,
    "data": 16,
    "data_low": 2,
    "background": 2,
}
"""Batches of 64 KiB that may wait on each link, by priority, allocated on demand.

Replies get a whole megabyte, because a message is dropped if one of its fragments finds no room.
"""


def _sizes(robot: str) -> list[dict[str, Any]]:
    """Return the size limits of messages by key; where several keys match, the smallest limit counts."""
    small = ("*/call/stop/**", "*/fetches/**", "Clock/restarts/**")
    middle = ("*/call/read/**", "*/requests/**", "*/announcements/**", "Clock/ready/**")
    return [
        _size(robot, "small", small, SMALL_MESSAGE_BYTES),
        _size(robot, "middle", middle, MEDIUM_MESSAGE_BYTES),
        _size(robot, "large", ("**",), MAX_MESSAGE_BYTES + SMALL_MESSAGE_BYTES),
    ]


def _size(robot: str, name: str, key_exprs: tuple[str, ...], limit: int) -> dict[str, Any]:
    return {
        "id": name,
        "link_protocols": _REMOTE,
        "flows": ["ingress"],
        "messages": ["put"],
        "key_exprs": [keys.prefix(robot) + key for key in key_exprs],
        "size_limit": limit,
    }


def _urgency(robot: str) -> list[dict[str, Any]]:
    """Return the priorities by key; the last match counts, and no message waits for room."""
    frames = ("*/requests/**", "*/announcements/**", "Clock/ready/**", "Clock/restarts/**")
    calls = {"priority": "data", "congestion_control": "drop", "express": False}
    return [
        _overwrite(robot, "out", "egress", ("**",), {"congestion_control": "drop"}),
        _overwrite(robot, "in", "ingress", ("**",), calls),
        _overwrite(robot, "frames", "ingress", frames, {"priority": "interactive_high"}),
        _overwrite(
            robot, "stops", "ingress", ("*/call/stop/**",), {"priority": "real_time", "express": True}
        ),
    ]


def _overwrite(
    robot: str, name: str, flow: str, key_exprs: tuple[str, ...], overwrite: dict[str, Any]
) -> dict[str, Any]:
    return {
        "id": name,
        "link_protocols": _REMOTE,
        "flows": [flow],
        "messages": ["put", "delete"],
        "key_exprs": [keys.prefix(robot) + key for key in key_exprs],
        "overwrite": overwrite,
    }


def allow_descriptors() -> None:
    """Raise this process's limit of open files to `MAX_OPEN_FILES`, or as far as the system allows."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    target = MAX_OPEN_FILES if hard == resource.RLIM_INFINITY else min(MAX_OPEN_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < target:
        resource.setrlimit(resource.RLIMIT_NOFILE, (target, hard))
