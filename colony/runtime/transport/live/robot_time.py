"""The robot's time on another machine, learned from the ticks of its Clock.

A tick tells the time at which it was due, and arrives later: by how much is unknown, but never less than
nothing. So of all differences between the tick's time and the arrival, the greatest is the nearest to the
truth. Clocks of two machines drift apart, so an old difference loses worth by `DRIFT`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Event

import zenoh

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.codec import NotAMessage
from colony.runtime.protocol.messages import Tick
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.errors import NotReached
from colony.runtime.transport.live.network import ZenohSession, local_time
from colony.runtime.transport.live.place import Local

DRIFT = 1e-4
"""Seconds by which two clocks differ after a second, at most."""

FIRST_TICK_S = 5.0


class LearnedTime:
    """Mutable: the best difference so far.

    Args:
        monotonic: this machine's clock in nanoseconds.

    Attributes:
        stop_listening: ends its own subscription to ticks, in a process that calls `heard` with each of them.
    """

    def __init__(self, monotonic: Callable[[], int] = time.monotonic_ns) -> None:
        self._monotonic = monotonic
        self.stop_listening: Callable[[], None] = lambda: None
        self._best: tuple[int, int] | None = None
        self._last_ns = 0

    @property
    def known(self) -> bool:
        """Whether a tick was heard."""
        return self._best is not None

    def heard(self, t_ns: int) -> None:
        """A tick that was due at `t_ns` has just arrived."""
        now = self._monotonic()
        found = t_ns - now
        if self._best is not None:
            offset, at = self._best
            if found < offset - int(DRIFT * (now - at)):
                return
        self._best = (found, now)

    def __call__(self) -> int:
        """The robot's time; it never goes back. 0 before the first tick."""
        if self._best is not None:
            self._last_ns = max(self._last_ns, self._monotonic() + self._best[0])
        return self._last_ns


def time_of(network: ZenohSession) -> Callable[[], int]:
    """The robot's time in nanoseconds: that of this machine where the robot is on it, else as it is learned.

    Raises:
        RunDirectoryError: the robot's folder cannot be used.
        NotReached: no tick came.
    """
    place = network.place
    return local_time(place) if isinstance(place, Local) else learned_time(network)


def learned_time(network: ZenohSession, *, timeout_s: float = FIRST_TICK_S) -> LearnedTime:
    """The time of a robot of another machine, once a tick was heard; it goes on learning.

    Raises:
        NotReached: no tick came.
    """
    learned, first = LearnedTime(), Event()

    def take(sample: zenoh.Sample) -> None:
        try:
            message = codec.decode(sample.payload.to_bytes())
        except NotAMessage:
            return
        if isinstance(message, Tick):
            learned.heard(message.t_ns)
            first.set()

    key = keys.listening(network.robot, topics.TICKS)
    subscriber = network.session.declare_subscriber(key, zenoh.handlers.Callback(take, indirect=False))
    learned.stop_listening = subscriber.undeclare
    if not first.wait(timeout_s):
        raise NotReached(f"{network.robot}: no tick of its Clock came in {timeout_s:g} s: does it run?")
    return learned
