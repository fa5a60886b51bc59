"""Membership of clients, or of a module in Python, in a run.

Members report that they are ready until the frames of the run come, and request a new epoch when they cannot
continue.
"""

from __future__ import annotations

from collections.abc import Iterator

from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Effect, Ready, Restart, Send, Tick

READY_AGAIN_NS = 200_000_000
"""Nanoseconds between two reports that a member is ready, until the frames of the run come."""

ALIVE_AGAIN_NS = 90_000_000
"""Least nanoseconds between two signs of life of a client to the Clock.

They are a fraction of the shortest lease. The verdicts also inform the Clock of requests that were on time.
"""


class Membership:
    """The members of a node, by address. Mutable: the times of their last reports as ready and as alive."""

    def __init__(self, members: tuple[str, ...], run: str) -> None:
        self.run = run
        self._members = members
        self._said_ns = 0
        self._lived_ns: int | None = None

    def start(self, now_ns: int) -> Iterator[Effect]:
        """Report the members as ready."""
        self._said_ns = now_ns
        yield from self._say(-1)

    def heard(self, tick: Tick, now_ns: int) -> Iterator[Effect]:
        """Handle a tick; while it is not of this run, report the members as ready from time to time.

        The Clock may not know yet that this process is ready: its report was lost, or the Clock was
        restarted.
        """
        if tick.run != self.run and now_ns - self._said_ns >= READY_AGAIN_NS:
            yield from self.start(now_ns)

    def requested(self, k: int, now_ns: int) -> Iterator[Effect]:
        """Note that the requests for frame `k` were sent, and report the members as alive."""
        if self._lived_ns is None or now_ns - self._lived_ns >= ALIVE_AGAIN_NS:
            self._lived_ns = now_ns
            yield from self._say(k)

    def begin_anew(self, start: int) -> Effect:
        """Return a request for a new epoch, as the members cannot continue in the one begun at `start`."""
        return Send(topics.RESTARTS, Restart(client=self._members[0], start=start))

    def _say(self, k: int) -> Iterator[Effect]:
        for member in self._members:
            yield Send(topics.READY, Ready(client=member, run=self.run, k=k))
