"""How clients, or a module in Python, take part in a run: they say that they are ready until the frames of
the run come, and ask for a new epoch when they cannot go on.
"""

from __future__ import annotations

from collections.abc import Iterator

from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Effect, Ready, Restart, Send, Tick

READY_AGAIN_NS = 200_000_000
"""Nanoseconds between two times that a member says that it is ready, until the frames of the run come."""

ALIVE_AGAIN_NS = 90_000_000
"""Least nanoseconds between two signs of life of a client to the Clock. They are a part of the shortest
lease. The verdicts tell the Clock of requests that were on time, too."""


class Membership:
    """Mutable: when the members, given by address, said last that they are ready, and that they live."""

    def __init__(self, members: tuple[str, ...], run: str) -> None:
        self.run = run
        self._members = members
        self._said_ns = 0
        self._lived_ns: int | None = None

    def start(self, now_ns: int) -> Iterator[Effect]:
        """They are ready."""
        self._said_ns = now_ns
        yield from self._say(-1)

    def heard(self, tick: Tick, now_ns: int) -> Iterator[Effect]:
        """A tick came. While it is not of this run, the Clock may not know yet that this process is ready:
        what it said was lost, or the Clock was started anew.
        """
        if tick.run != self.run and now_ns - self._said_ns >= READY_AGAIN_NS:
            yield from self.start(now_ns)

    def requested(self, k: int, now_ns: int) -> Iterator[Effect]:
        """Their requests for frame `k` were sent: they live."""
        if self._lived_ns is None or now_ns - self._lived_ns >= ALIVE_AGAIN_NS:
            self._lived_ns = now_ns
            yield from self._say(k)

    def begin_anew(self, start: int) -> Effect:
        """They cannot go on in the epoch that began with this frame."""
        return Send(topics.RESTARTS, Restart(client=self._members[0], start=start))

    def _say(self, k: int) -> Iterator[Effect]:
        for member in self._members:
            yield Send(topics.READY, Ready(client=member, run=self.run, k=k))
