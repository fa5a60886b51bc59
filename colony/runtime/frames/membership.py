"""How a process takes part in a run: it says that it is ready until the frames of the run come, and asks for
a new epoch when it cannot go on."""

from __future__ import annotations

from collections.abc import Iterator

from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Effect, Ready, Restart, Send, Tick

READY_AGAIN_NS = 200_000_000
"""While the frames are not those of the run, every so often it is said again that one is ready."""

ALIVE_AGAIN_NS = 40_000_000
"""How often a client that sends requests tells the Clock so, at most: in each frame, unless frames are
shorter than that. It is a small part of the shortest lease."""


class Membership:
    """Of one process, by address. Mutable: when it said last that it is ready, and that it lives."""

    def __init__(self, address: str, run: str) -> None:
        self.run = run
        self._address = address
        self._said_ns = 0
        self._lived_ns: int | None = None

    def start(self, now_ns: int) -> Iterator[Effect]:
        """It is ready."""
        self._said_ns = now_ns
        yield Send(topics.READY, Ready(client=self._address, run=self.run))

    def heard(self, tick: Tick, now_ns: int) -> Iterator[Effect]:
        """A tick came. While it is not of this run, the Clock may not know yet that this process is ready:
        what it said was lost, or the Clock was started anew."""
        if tick.run != self.run and now_ns - self._said_ns >= READY_AGAIN_NS:
            yield from self.start(now_ns)

    def requested(self, k: int, now_ns: int) -> Iterator[Effect]:
        """Its request for frame `k` was sent: it lives."""
        if self._lived_ns is None or now_ns - self._lived_ns >= ALIVE_AGAIN_NS:
            self._lived_ns = now_ns
            yield Send(topics.READY, Ready(client=self._address, run=self.run, k=k))

    def begin_anew(self, start: int) -> Effect:
        """It cannot go on in the epoch that began with this frame."""
        return Send(topics.RESTARTS, Restart(client=self._address, start=start))
