"""The robot's time on another machine, learned from the ticks of its Clock.

A tick contains the time at which it was due, and arrives later by an unknown delay that is never negative.
The offset, the tick's time minus the time of its arrival, is too small by that delay, so the greatest offset
is the most accurate. The clocks of two machines drift apart, so `DRIFT` times its age is subtracted from an
old one.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Event

import zenoh

from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.codec import MessageFormatError
from colony.runtime.protocol.messages import Tick
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.network import ZenohSession, local_time
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.live.run_directory import UnreachableError

DRIFT = 1e-4
"""Maximum drift between two clocks, in seconds per second."""

FIRST_TICK_TIMEOUT_S = 5.0


class LearnedTime:
    """A clock learned from ticks. Stateful: remembers the best difference so far.

    Args:
        monotonic: clock of this machine, in nanoseconds.

    Attributes:
        stop_listening: function that ends the clock's own subscription to ticks, for a process that calls
            `on_tick` itself.
    """

    def __init__(self, monotonic: Callable[[], int] = time.monotonic_ns) -> None:
        self._monotonic = monotonic
        self.stop_listening: Callable[[], None] = lambda: None
        self._best: tuple[int, int] | None = None
        self._last_ns = 0

    @property
    def has_ticked(self) -> bool:
        """True once a tick has arrived."""
        return self._best is not None

    def on_tick(self, t_ns: int) -> None:
        """Take a tick that was due at `t_ns` and arrives now."""
        now_ns = self._monotonic()
        offset_ns = t_ns - now_ns
        if self._best is not None:
            best_offset_ns, best_ns = self._best
            if offset_ns < best_offset_ns - int(DRIFT * (now_ns - best_ns)):
                return
        self._best = (offset_ns, now_ns)

    def __call__(self) -> int:
        """Return the robot's time in nanoseconds. It never goes back, and is 0 before the first tick."""
        if self._best is not None:
            self._last_ns = max(self._last_ns, self._monotonic() + self._best[0])
        return self._last_ns


def time_of(network: ZenohSession) -> Callable[[], int]:
    """Return the robot's clock in nanoseconds: based on this machine's if the robot is local, else learned.

    Raises:
        RunDirectoryError: the robot's folder cannot be used.
        UnreachableError: no tick arrived.
    """
    robot_address = network.robot_address
    return local_time(robot_address) if isinstance(robot_address, Local) else learned_time(network)


def learned_time(network: ZenohSession, *, timeout_s: float = FIRST_TICK_TIMEOUT_S) -> LearnedTime:
    """Wait for a tick of a robot on another machine, and return its clock, which keeps learning.

    Raises:
        UnreachableError: no tick arrived within the timeout.
    """
    learned, first_tick = LearnedTime(), Event()

    def take(sample: zenoh.Sample) -> None:
        try:
            message = codec.decode(sample.payload.to_bytes())
        except MessageFormatError:
            return
        if isinstance(message, Tick):
            learned.on_tick(message.t_ns)
            first_tick.set()

    key = keys.subscription_key(network.robot, topics.TICKS)
    subscriber = network.session.declare_subscriber(key, zenoh.handlers.Callback(take, indirect=False))
    learned.stop_listening = subscriber.undeclare
    if not first_tick.wait(timeout_s):
        raise UnreachableError(f"{network.robot}: no tick of its Clock in {timeout_s:g} s: is it running?")
    return learned
