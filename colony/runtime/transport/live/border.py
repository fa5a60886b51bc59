"""The border of a process: the rates at which users of other machines may send.

The keys of all messages from clients carry the user, and the gateway ties these keys to certificates. So a
message is counted before it is decoded, for a fraction of what decoding costs. The processes of this machine,
which all go by one user, are not counted: they would share one rate, and a program that calls without end is
held back by the number of its calls that wait (`waiting.py`). Their messages under the right to stop are
counted, by connection: the queue of these (`stop_lane.py`) has no limit for each connection.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from colony.runtime.protocol.topics import user_of
from colony.runtime.transport.live.meter import Meter, Rate

CALLS = Rate(per_s=2000.0, burst=1000.0)
"""Calls and signs of life of one user at one server, other than under the right to stop. A program that waits
for each answer makes fewer."""

STOPS = Rate(per_s=500.0, burst=100.0)
"""Calls and signs of life of one user, or of one connection of this machine, under the right to stop. Further
stops change nothing."""

FETCHES = Rate(per_s=500.0, burst=500.0)
"""Fetches of one user's programs: requests for frames that they missed."""

PROGRAMS = Rate(per_s=20_000.0, burst=10_000.0)
"""Messages of frames, other than fetches, from the clients that one user runs."""

REFUSALS = Rate(per_s=20.0, burst=20.0)
"""Calls of one user over the rate that are refused with the code `flood`; the others are dropped without a
reply."""


class Border:
    """The rates at one server. Mutable: what is left of them. Threads may share it.

    Args:
        local_user: the user of this machine's processes, whose messages pass uncounted, except those under
            the right to stop.
        monotonic: returns the time in nanoseconds.
    """

    def __init__(self, local_user: str, monotonic: Callable[[], int] = time.monotonic_ns) -> None:
        self._local = local_user
        self._now = monotonic
        self._calls, self._stops = Meter(CALLS), Meter(STOPS)
        self._fetches, self._programs = Meter(FETCHES), Meter(PROGRAMS)
        self._refusals = Meter(REFUSALS)

    def call(self, connection: str, size: int) -> bool:
        """Count a call, or a sign of life, of `size` bytes; return whether it may come in."""
        user = user_of(connection)
        return user == self._local or self._calls.take(user, size, self._now())

    def stop(self, connection: str, size: int) -> bool:
        """Count a message of `size` bytes under the right to stop; return whether it may come in."""
        user = user_of(connection)
        return self._stops.take(connection if user == self._local else user, size, self._now())

    def frame(self, kind: str, user: str, size: int, count: int = 1) -> bool:
        """Count messages of a frame, such as those of kind "requests", of `size` bytes together; return
        whether they may come in."""
        if user == self._local:
            return True
        meter = self._fetches if kind == "fetches" else self._programs
        return meter.take(user, size, self._now(), count)

    def refusal(self, connection: str) -> bool:
        """Count a call over the rate; return whether it gets a reply, rather than being dropped."""
        return self._refusals.take(user_of(connection), 0, self._now())
