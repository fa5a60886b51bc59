"""What the gateway takes from other machines, and gives to them: bounds of size, number and time.

A gateway never waits for a receiver: what a busy server or a slow user leaves no room for is dropped, and
asked again by the protocol (a call after 250 ms, with its number; a frame at the next tick). Waiting would
hold up everybody else, and zenoh closes a link on which it waited in vain. For the same reason users choose
neither their priority nor what happens when there is no room: the key of a message decides.

Nothing here bounds the number of messages. Zenoh's `downsampling` knows no bursts: of calls that a user makes
at once it would drop all but one, and again when they are repeated, which is at once again. Servers count.
"""

from __future__ import annotations

import resource
from typing import Any

from colony.runtime.codec import LARGEST
from colony.runtime.live import keys

HANDSHAKE_MS = 2000
"""After this time without its end a TLS handshake is given up, and its connection closed."""

LOGIN_MS = 2000
"""The same for the login of zenoh, which only comes after TLS found the certificate good."""

LOGINS_PENDING = 100
SESSIONS = 200
"""Of users and of the robot's own processes together."""

DESCRIPTORS = 8192
"""Files that a gateway may have open, if the system allows it: many more connections than can wait for their
handshake to be given up."""

SMALL, MIDDLE = 1024, 64 * 1024
_REMOTE = ["tls"]


def limits(robot: str) -> dict[str, Any]:
    """The settings of a gateway that bound what goes through it."""
    return {
        "transport/unicast/accept_timeout": LOGIN_MS,
        "transport/unicast/accept_pending": LOGINS_PENDING,
        "transport/unicast/max_sessions": SESSIONS,
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
"""Batches of 64 KiB that wait on each link, made as they are needed: a whole megabyte of replies, because a
fragment without room drops its message."""


def _sizes(robot: str) -> list[dict[str, Any]]:
    """Bytes of the largest message on a key; where several match, the smallest counts."""
    small = ("*/call/stop/**", "*/fetches/**", "Clock/ready/**", "Clock/restarts/**")
    return [
        _size(robot, "small", small, SMALL),
        _size(robot, "middle", ("*/call/read/**", "*/requests/**", "*/announcements/**"), MIDDLE),
        _size(robot, "large", ("**",), LARGEST + SMALL),
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
    """Priorities by key, the last that matches counts; and nothing waits for room."""
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
    """Raise this process's own bound of open files as far as it may."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = DESCRIPTORS if hard == resource.RLIM_INFINITY else min(DESCRIPTORS, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
