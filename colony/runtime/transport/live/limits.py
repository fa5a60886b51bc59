"""The gateway's limits: sizes, counts and timeouts of traffic between the robot and other machines.

A gateway never waits for a receiver. When the queue to a busy server or a slow user is full, it drops
messages, and the protocol sends them again (a call after 250 ms, with the same number; a frame at the next
tick). Waiting would block all other users, and zenoh closes a link after waiting in vain. For the same reason
users choose neither the priority of a message nor whether it may wait: its key decides.

Nothing here limits the rate of messages. Zenoh's `downsampling` allows no bursts: of simultaneous calls of
one user it would drop all but one, and drop them again when they are retried, again simultaneously. Servers
count messages instead (`RateLimits`).
"""

from __future__ import annotations

import resource
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock
from typing import Any, NamedTuple

from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.protocol.topics import user_of
from colony.runtime.transport.live import keys

# --- meter ---------------------------------------------------------------------------------------------
#
# Rates of messages, by sender, as token buckets.
#
# A sender begins with `burst` tokens and gains `per_s` tokens a second, up to `burst`. A message costs one
# token, and one more for each `BYTES_PER_TOKEN` of its size. A sender with too few tokens is over its rate.


BYTES_PER_TOKEN = 16_384
"""Bytes of a message that cost one extra token."""

MAX_SENDERS = 1024
"""Maximum number of buckets. Beyond that, the bucket of the least recently active sender is dropped."""


class Rate(NamedTuple):
    """The tokens gained per second, and the maximum that a sender may accumulate."""

    per_s: float
    burst: float


@dataclass(frozen=False, slots=True)
class _Bucket:
    tokens: float
    updated_ns: int


class Meter:
    """A token bucket per sender. Mutable. Threads may share it."""

    def __init__(self, rate: Rate) -> None:
        self._per_ns = rate.per_s / 1e9
        self._burst = rate.burst
        self._buckets: OrderedDict[str, _Bucket] = OrderedDict()
        self._lock = Lock()

    def take(self, sender: str, size: int, now_ns: int, count: int = 1) -> bool:
        """Pay for `count` messages of `size` bytes in total; return False if the sender is over its rate.

        `now_ns` is a monotonic time.
        """
        cost = count + size // BYTES_PER_TOKEN
        with self._lock:
            bucket = self._bucket(sender, now_ns)
            if bucket.tokens < cost:
                return False
            bucket.tokens -= cost
            return True

    def _bucket(self, sender: str, now_ns: int) -> _Bucket:
        """Return a sender's bucket, refilled up to `now_ns`."""
        bucket = self._buckets.get(sender)
        if bucket is None:
            bucket = self._buckets[sender] = _Bucket(self._burst, now_ns)
            if len(self._buckets) > MAX_SENDERS:
                self._buckets.popitem(last=False)
        elif now_ns > bucket.updated_ns:
            self._buckets.move_to_end(sender)
            bucket.tokens = min(self._burst, bucket.tokens + (now_ns - bucket.updated_ns) * self._per_ns)
            bucket.updated_ns = now_ns
        return bucket


# --- rate limits ---------------------------------------------------------------------------------------
#
# Limits on the rates at which users on other machines may send messages to a process.
#
# The keys of all messages from clients contain the user, and the gateway ties these keys to certificates.
# Messages are therefore counted before they are decoded, which costs far less. Processes on this machine
# share one user and are not counted, because they would share one rate; the limit on queued calls restrains
# a program that calls without end (`inbox.py`). Their messages with the `stop` right are counted by
# connection, because the queue of these messages (`reception.py`) has no limit per connection.


CALL_RATE = Rate(per_s=2000.0, burst=1000.0)
"""The rate of calls and keepalives of one user at one server, except those with the `stop` right.

A program that waits for each reply stays below this rate.
"""

STOP_RATE = Rate(per_s=500.0, burst=100.0)
"""The rate of calls and keepalives with the `stop` right, per user or local connection.

Further stops would change nothing.
"""

FETCH_RATE = Rate(per_s=500.0, burst=500.0)
"""The rate of fetches (requests for missed frames) of one user's programs."""

PROGRAM_RATE = Rate(per_s=20_000.0, burst=10_000.0)
"""The rate of frame messages, except fetches, from one user's clients."""

REFUSAL_RATE = Rate(per_s=20.0, burst=20.0)
"""The rate of refusals (code `flood`) of one user's excess calls; further ones are dropped silently."""


class RateLimits:
    """The rate limits of one server. Mutable. Threads may share it.

    Args:
        local_user: user of the processes on this machine, whose messages are not counted, except those with
            the `stop` right.
        monotonic: monotonic clock in nanoseconds.
    """

    def __init__(self, local_user: str, monotonic: Callable[[], int] = time.monotonic_ns) -> None:
        self._local = local_user
        self._now = monotonic
        self._calls, self._stops = Meter(CALL_RATE), Meter(STOP_RATE)
        self._fetches, self._programs = Meter(FETCH_RATE), Meter(PROGRAM_RATE)
        self._refusals = Meter(REFUSAL_RATE)

    def admit_call(self, connection: str, size: int) -> bool:
        """Count a call or keepalive of `size` bytes; return True if it is within the rate."""
        user = user_of(connection)
        return user == self._local or self._calls.take(user, size, self._now())

    def admit_stop(self, connection: str, size: int) -> bool:
        """Count a message of `size` bytes with the `stop` right; return True if it is within the rate."""
        user = user_of(connection)
        return self._stops.take(connection if user == self._local else user, size, self._now())

    def admit_frame(self, kind: str, user: str, size: int, count: int = 1) -> bool:
        """Count frame messages of one `kind`, such as "requests"; return True if they are within the rate.

        `size` is the total of all `count` messages in bytes.
        """
        if user == self._local:
            return True
        meter = self._fetches if kind == "fetches" else self._programs
        return meter.take(user, size, self._now(), count)

    def admit_refusal(self, connection: str) -> bool:
        """Count an excess call; return True if it gets a refusal, False if it is dropped."""
        return self._refusals.take(user_of(connection), 0, self._now())


# --- limits --------------------------------------------------------------------------------------------


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
