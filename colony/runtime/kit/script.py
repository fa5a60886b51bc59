"""A client as a generator of what it asks of servers: the same program over live connections, among the nodes
of a run in virtual time, and inside one process at the speed of a simulation.

    def beacon() -> Script:
        yield from do("DServer", data.create_semaphore("$Lit", 0))
        while True:
            now_ns = yield from sleep(0.5)
            where = yield from do("RServer", robot.position())
            yield from do("DServer", data.set("LastSeen", (now_ns, where.x, where.y)))

A script has no threads, no clock and no sockets; its runner does what it yields and sends back the answer. A
call that is refused, or lost, is raised in it as the kit's connections raise it (`kit/errors.py`).
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, NamedTuple, TypeVar

from colony.runtime.library.ask import Ask

T = TypeVar("T")


class Do(NamedTuple):
    """A step: make this call to a server. It gives the result of the call."""

    server: str
    ask: Ask[Any]


class Sleep(NamedTuple):
    """A step: wait. It gives the robot's time then, in nanoseconds."""

    seconds: float


Step = Do | Sleep
Script = Generator[Step, Any, None]
"""A client. It ends when the generator does; to end it from outside, close the generator."""


def do(server: str, ask: Ask[T]) -> Generator[Step, Any, T]:
    """Make a call to a server, and wait for the result.

    Raises:
        CallRefused, ConnectionLost, TimedOut: there is none.
    """
    answer: T = yield Do(server, ask)
    return answer


def sleep(seconds: float) -> Generator[Step, Any, int]:
    """Wait, and return the robot's time then, in nanoseconds. 0 seconds ask for the time."""
    now_ns: int = yield Sleep(seconds)
    return now_ns
