"""How long an emergency stop takes, from a user behind the gateway, while others flood it."""

from __future__ import annotations

import time
from collections.abc import Iterator

from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import ConnectionLost
from colony.runtime.library import robot

PATIENCE_S = 60.0


def stop_and_release(base: Connection, at_home: Connection) -> float:
    """Stop the robot from afar, and release it at home; how many seconds passed until the stop was
    acknowledged."""
    begin = time.monotonic()
    base.do(robot.emergency_stop())
    took = time.monotonic() - begin
    while True:
        try:
            at_home.do(robot.release())
            return took
        except ConnectionLost:  # of a server that is flooded; to release twice is to release
            continue


def stop_times(guard: Session, home: Session, number: int) -> Iterator[float]:
    """Seconds from sending each stop to its acknowledgment, on one connection that stands."""
    with (
        guard.connect("RServer", name="guard", timeout_s=PATIENCE_S) as base,
        home.connect("RServer", name="home", timeout_s=PATIENCE_S, priority=2_000) as at_home,
    ):
        for _ in range(number):
            yield stop_and_release(base, at_home)
