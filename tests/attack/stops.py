"""How long an emergency stop takes while others attack: until every server has acknowledged it, and idles."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import zenoh

from colony.runtime import codec, topics
from colony.runtime.kit.connection import Session
from colony.runtime.kit.emergency import StopButton
from colony.runtime.library import clock
from colony.runtime.live import keys
from colony.runtime.messages import Verdict
from tests.cli.machine import ROBOT, until

PATIENCE_S = 60.0
PAUSE_S = 0.1
"""Between a release and the next stop: the robot is in motion again."""


class Stop(NamedTuple):
    """One emergency stop: seconds until it was acknowledged by all, and the frames that were still decided as
    if there were none."""

    seconds: float
    frames: int


class Decisions:
    """What RServer decides, as its verdicts tell. Mutable: those of late."""

    def __init__(self) -> None:
        self._verdicts: list[Verdict] = []

    def hear(self, sample: zenoh.Sample) -> None:
        """In a thread of the network."""
        verdict = codec.decode(sample.payload.to_bytes())
        if isinstance(verdict, Verdict) and verdict.actuator == "drive":
            self._verdicts.append(verdict)

    @property
    def count(self) -> int:
        return len(self._verdicts)

    def stopped_after(self, count: int) -> int | None:
        """How many decisions came, after the first `count`, before one that the stop decided."""
        later = self._verdicts[count:]
        return next((n for n, verdict in enumerate(later) if verdict.hold == "stopped"), None)


@contextmanager
def decisions(home: Session) -> Iterator[Decisions]:
    """Listen to RServer's decisions, on the robot's own machine."""
    heard = Decisions()
    handler = zenoh.handlers.Callback(heard.hear, indirect=False)
    key = keys.listening(ROBOT, topics.VERDICTS)
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
