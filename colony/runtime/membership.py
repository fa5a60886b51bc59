"""How a process takes part in a run: it says that it is ready until the frames of the run come, and asks for
a new epoch when it cannot go on."""

from __future__ import annotations

from collections.abc import Iterator

from colony.runtime import topics
from colony.runtime.messages import Effect, Ready, Restart, Send, Tick

READY_AGAIN_NS = 200_000_000
"""While the frames are not those of the run, every so often it is said again that one is ready."""


class Membership:
    """Of one process, by address. Mutable: when it said last that it is ready."""

    def __init__(self, address: str, run: str) -> None:
        self.run = run
        self._address = address
        self._said_ns = 0

    def start(self, now_ns: int) -> Iterator[Effect]:
        """It is ready."""
        self._said_ns = now_ns
        yield Send(topics.READY, Ready(client=self._address, run=self.run))

    def heard(self, tick: Tick, now_ns: int) -> Iterator[Effect]:
        """A tick came. While it is not of this run, the Clock may not know yet that this process is ready:
        what it said was lost, or the Clock was started anew."""
        if tick.run != self.run and now_ns - self._said_ns >= READY_AGAIN_NS:
            yield from self.start(now_ns)

    def begin_anew(self, start: int) -> Effect:
        """It cannot go on in the epoch that began with this frame."""
        return Send(topics.RESTARTS, Restart(client=self._address, start=start))
