"""The time that an emergency stop takes during an attack, until every server has acknowledged it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import zenoh

from colony.runtime.kit.connection import Session
from colony.runtime.kit.emergency import StopButton
from colony.runtime.library import clock
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.messages import Verdict
from colony.runtime.transport.live import keys
from tests.cli.machine import ROBOT
from tests.waiting import until

PATIENCE_S = 60.0
PAUSE_S = 0.1
"""Seconds between a release and the next stop, in which the robot begins to move again."""


class Stop(NamedTuple):
    """One emergency stop: the seconds until every server had acknowledged it, and the number of frames that
    were decided without it after it was sent."""

    seconds: float
    frames: int


class Decisions:
    """Decisions of RServer about the actuator `drive`. Mutable: the verdicts that came."""

    def __init__(self) -> None:
        self._verdicts: list[Verdict] = []

    def hear(self, sample: zenoh.Sample) -> None:
        """Take a verdict; called in a thread of the network."""
        verdict = codec.decode(sample.payload.to_bytes())
        if isinstance(verdict, Verdict) and verdict.actuator == "drive":
            self._verdicts.append(verdict)

    @property
    def count(self) -> int:
        return len(self._verdicts)

    def stopped_after(self, count: int) -> int | None:
        """Return how many decisions came, after the first `count`, before the first that the stop decided."""
        later = self._verdicts[count:]
        return next((n for n, verdict in enumerate(later) if verdict.hold == "stopped"), None)


@contextmanager
def decisions(home: Session) -> Iterator[Decisions]:
    """Listen to RServer's decisions, on the robot's own machine."""
    heard = Decisions()
    handler = zenoh.handlers.Callback(heard.hear, indirect=False)
    key = keys.subscription_key(ROBOT, topics.VERDICTS)
    subscriber = home.hub.network.session.declare_subscriber(key, handler)
    try:
        yield heard
    finally:
        subscriber.undeclare()  # type: ignore[no-untyped-call]


def stop_times(guard: Session, home: Session, number: int) -> Iterator[Stop]:
    """Stop the robot again and again as `guard`, on connections that stand, and release it at home."""
    with (
        StopButton(guard, timeout_s=PATIENCE_S) as button,
        decisions(home) as decided,
        home.connect("Clock", name="home", timeout_s=PATIENCE_S) as at_home,
    ):
        until(lambda: decided.count > 0, "a frame is decided")
        for _ in range(number):
            count, begin = decided.count, time.monotonic()
            pressed = button.press()
            seconds = time.monotonic() - begin
            assert pressed.kept, pressed.problems
            until(lambda n=count: decided.stopped_after(n) is not None, "the robot idles")  # type: ignore[misc]
            frames = decided.stopped_after(count)
            assert frames is not None
            at_home.do(clock.release())
            yield Stop(seconds, frames)
            time.sleep(PAUSE_S)
