"""Membership of clients, or of a module in Python, in a run.

Members report that they are ready until the run begins, and request a new epoch when they cannot continue.
With the first report of each node goes its progress, if the run has begun before: the Clock was restarted.
"""

from __future__ import annotations

from collections.abc import Iterator

from colony.runtime.frames.assembler import FrameAssembler
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Effect, Ready, Restart, Send, Tick

READY_INTERVAL_NS = 200_000_000
"""Nanoseconds between two reports of readiness, until the run begins."""

ALIVE_INTERVAL_NS = 90_000_000
"""Shortest interval, in nanoseconds, between two reports to the Clock that a client is alive.

It is a fraction of the shortest lease. The Clock also learns from verdicts which clients are alive.
"""


class Membership:
    """The members of one node, by address. Stateful: remembers the times of their last reports.

    `assembler` knows the node's progress in the run.
    """

    def __init__(self, members: tuple[str, ...], run: str, assembler: FrameAssembler) -> None:
        self.run = run
        self._assembler = assembler
        self._members = members
        self._ready_sent_ns = 0
        self._alive_sent_ns: int | None = None

    def start(self, now_ns: int) -> Iterator[Effect]:
        """Report the members as ready."""
        self._ready_sent_ns = now_ns
        progress = self._assembler.progress
        for member in self._members:
            yield Send(topics.READY, Ready(client=member, run=self.run, progress=progress))
            progress = None

    def on_tick(self, tick: Tick, now_ns: int) -> Iterator[Effect]:
        """Handle a tick; until the run begins, report the members as ready from time to time.

        The Clock may not know: the report may have been lost, or the Clock restarted.
        """
        if tick.run != self.run and now_ns - self._ready_sent_ns >= READY_INTERVAL_NS:
            yield from self.start(now_ns)

    def on_requests_sent(self, k: int, now_ns: int) -> Iterator[Effect]:
        """Report the members as alive after their requests for frame `k`, unless they did so recently."""
        if self._alive_sent_ns is None or now_ns - self._alive_sent_ns >= ALIVE_INTERVAL_NS:
            self._alive_sent_ns = now_ns
            yield from self._report(k)

    def restart_request(self, start: int) -> Effect:
        """Return a request for a new epoch, as the members cannot continue in the one begun at `start`."""
        return Send(topics.RESTARTS, Restart(client=self._members[0], start=start))

    def _report(self, k: int) -> Iterator[Effect]:
        for member in self._members:
            yield Send(topics.READY, Ready(client=member, run=self.run, k=k))
