"""Limits on the rates at which users on other machines may send messages to a process.

The keys of all messages from clients contain the user, and the gateway ties these keys to certificates.
Messages are therefore counted before they are decoded, which costs far less. Processes on this machine share
one user and are not counted, because they would share one rate; the limit on queued calls restrains a program
that calls without end (`message_queue.py`). Their messages with the `stop` right are counted by connection,
because the queue of these messages (`stop_lane.py`) has no limit per connection.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from colony.runtime.protocol.topics import user_of
from colony.runtime.transport.live.meter import Meter, Rate

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
