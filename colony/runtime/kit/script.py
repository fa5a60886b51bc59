"""A client as a generator of its calls to servers.

The same script runs over live connections, among the nodes of a run in virtual time, and inside one process
at the speed of a simulation.

    def beacon() -> Script:
        yield from do("DServer", data.create_semaphore("$Lit", 0))
        while True:
            now_ns = yield from sleep(0.5)
            where = yield from do("RServer", robot.position())
            yield from do("DServer", data.set("LastSeen", (now_ns, where.x, where.y)))

A script has no threads, clock or sockets. Its runner performs each step that it yields and sends back the
answer. A failed call raises the same exception in the script as in the kit's connections (`kit/errors.py`).
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, NamedTuple, TypeVar

from colony.runtime.library.ask import CallRequest

T = TypeVar("T")


class Do(NamedTuple):
    """A step: make a call to a server. Its answer is the result of the call."""

    server: str
    call: CallRequest[Any]


class Sleep(NamedTuple):
    """A step: wait. Its answer is the robot's time afterwards, in nanoseconds."""

    seconds: float


Step = Do | Sleep
Script = Generator[Step, Any, None]
"""A client. It ends when the generator does; to end it from outside, close the generator."""


def do(server: str, call: CallRequest[T]) -> Generator[Step, Any, T]:
    """Make a call to a server, and wait for the result.

    Raises:
        CallRefusedError, ConnectionLostError, CallTimeoutError: the call has no result.
    """
    answer: T = yield Do(server, call)
    return answer


def sleep(seconds: float) -> Generator[Step, Any, int]:
    """Wait, and return the robot's time afterwards in nanoseconds; 0 seconds only return the time."""
    now_ns: int = yield Sleep(seconds)
    return now_ns
