"""The gateway's limits: sizes, counts and timeouts of traffic between the robot and other machines.

A gateway never waits for a receiver. When the queue to a busy server or a slow user is full, it drops
messages, and the protocol sends them again (a call after 250 ms, with the same number; a frame at the next
tick). Waiting would block all other users, and zenoh closes a link after waiting in vain. For the same reason
users choose neither the priority of a message nor whether it may wait: its key decides.

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
"""Timeout of a TLS handshake, in milliseconds; the connection is then closed."""

LOGIN_MS = 2000
"""Timeout of zenoh's login, in milliseconds. The login begins after TLS has accepted the certificate."""

MAX_PENDING_LOGINS = 100
"""Maximum number of simultaneous logins."""

MAX_SESSIONS = 200
"""Maximum number of sessions, of users and of the robot's own processes; each server has two."""

RECEIVING_THREADS = MAX_SESSIONS
"""Receiving threads of a gateway: one for each session.

A thread stays with a flooded session until it has handled up to 128 batches of 64 KiB. With fewer threads,
the emergency stops of other sessions would wait for their turn; with one each, the system decides who runs.
"""

MAX_OPEN_FILES = 8192
"""Maximum number of open files of a gateway, as far as the system permits.

Far more than the connections that can be waiting for their handshake timeout.
"""

SMALL_MESSAGE_BYTES, MEDIUM_MESSAGE_BYTES = 1024, 257 * 1024
"""Size limits, in bytes, of small and medium messages (`_size_limits`)."""

_REMOTE = ["tls"]


def limits(robot: str) -> dict[str, Any]:
    """Return the settings of a gateway that limit its traffic."""
    return {
        "transport/unicast/accept_timeout": LOGIN_MS,
        "transport/unicast/accept_pending": MAX_PENDING_LOGINS,
        "transport/unicast/max_sessions": MAX_SESSIONS,
        "transport/link/tx/queue/size": _QUEUES,
        "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 200_000,
        "low_pass_filter": list(_size_limits(robot)),
        "qos/network": list(_priorities(robot)),
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
"""Maximum number of batches of 64 KiB queued on each link, by priority; allocated on demand.

Replies get a whole megabyte, because a message is dropped if one of its fragments does not fit.
"""


def _size_limits(robot: str) -> list[dict[str, Any]]:
    """Return the size limits of messages by key; if several keys match, the smallest limit applies."""
    small = ("*/call/stop/**", "*/fetches/**", "Clock/restarts/**")
    medium = ("*/call/read/**", "*/requests/**", "*/announcements/**", "Clock/ready/**")
    return [
        _size_limit(robot, "small", small, SMALL_MESSAGE_BYTES),
        _size_limit(robot, "middle", medium, MEDIUM_MESSAGE_BYTES),
        _size_limit(robot, "large", ("**",), MAX_MESSAGE_BYTES + SMALL_MESSAGE_BYTES),
    ]


def _size_limit(robot: str, name: str, key_exprs: tuple[str, ...], limit: int) -> dict[str, Any]:
    return {
        "id": name,
        "link_protocols": _REMOTE,
        "flows": ["ingress"],
        "messages": ["put"],
        "key_exprs": [keys.prefix(robot) + key for key in key_exprs],
        "size_limit": limit,
    }


def _priorities(robot: str) -> list[dict[str, Any]]:
    """Return the priorities of messages by key; the last match applies. No message waits for room."""
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
    """Raise this process's limit on open files to `MAX_OPEN_FILES`, or as far as the system allows."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    target = MAX_OPEN_FILES if hard == resource.RLIM_INFINITY else min(MAX_OPEN_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < target:
        resource.setrlimit(resource.RLIMIT_NOFILE, (target, hard))
