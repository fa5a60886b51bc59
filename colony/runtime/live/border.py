"""Who gets past the border of a process: the rates of users of other machines.

Users stand in the keys of all that clients send, and the gateway ties these keys to certificates. So a
message can be counted before it is read, for a fraction of what reading it costs. The processes of this
machine, which all go by one user, are not counted: they would share one rate, and a program that calls
without end is held back by the number of its calls that wait (`waiting.py`).
"""

from __future__ import annotations

import time
from collections.abc import Callable

from colony.runtime.live.meter import Meter, Rate

CALLS = Rate(per_s=2000.0, burst=1000.0)
"""Calls and signs of life of one user at one server, emergency stops aside. A program that waits for each
answer makes fewer."""

STOPS = Rate(per_s=500.0, burst=100.0)
"""Calls and signs of life under the right to stop. One stop does as much as many."""

FETCHES = Rate(per_s=500.0, burst=500.0)
"""Frames that a user's programs ask for once more."""

PROGRAMS = Rate(per_s=20_000.0, burst=10_000.0)
"""All that the clients of a program send in frames."""

REFUSALS = Rate(per_s=20.0, burst=20.0)
"""Calls over the rate that are answered `flood`; the others are dropped without a word."""


class Border:
    """The rates at one server. Mutable: what is left of them. Threads may share it.

    Args:
        local_user: the user of this machine's processes, who is not counted.
        monotonic: a clock, in nanoseconds.
    """

    def __init__(self, local_user: str, monotonic: Callable[[], int] = time.monotonic_ns) -> None:
        self._local = local_user
        self._now = monotonic
        self._calls, self._stops = Meter(CALLS), Meter(STOPS)
        self._fetches, self._programs = Meter(FETCHES), Meter(PROGRAMS)
        self._refusals = Meter(REFUSALS)

    def call(self, connection: str, size: int) -> bool:
        """Return whether a call may come in."""
        user = connection.partition("/")[0]
        return user == self._local or self._calls.take(user, size, self._now())

    def stop(self, connection: str, size: int) -> bool:
        """Return whether a call under the right to stop may come in."""
        return self._stops.take(connection.partition("/")[0], size, self._now())

    def frame(self, kind: str, user: str, size: int) -> bool:
        """Return whether a message of frames of a kind ("fetches", "requests", ...) may come in."""
        if user == self._local:
            return True
        meter = self._fetches if kind == "fetches" else self._programs
        return meter.take(user, size, self._now())

    def refusal(self, connection: str) -> bool:
        """Return whether the sender of a call over the rate is to be told."""
        return self._refusals.take(connection.partition("/")[0], 0, self._now())
