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

import heapq
from collections import deque
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

from colony.runtime.kit.errors import RobotConnectionError
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import LATER

T = TypeVar("T")

MAX_STEPS_PER_INSTANT = 20_000
"""Maximum number of steps of a script at one instant; beyond it, the script is taken to loop forever."""


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


class ScriptError(Exception):
    """An exception raised by a script: `problem`."""

    def __init__(self, name: str, problem: Exception) -> None:
        super().__init__(f"the script `{name}` raised {type(problem).__name__}: {problem}")
        self.name, self.problem = name, problem


@dataclass(frozen=False, slots=True, kw_only=True, eq=False)
class RunningScript:
    """A script between its steps. Mutable."""

    name: str
    script: Script
    has_ended: bool = False

    def next(self, value: object, problem: Exception | None) -> Step | None:
        """Send the script its answer, or raise `problem` in it; return its next step, None at its end.

        Raises:
            Exception: as raised by the script, which has ended.
        """
        try:
            return self.script.send(value) if problem is None else self.script.throw(problem)
        except BaseException as end:
            self.has_ended = True
            if isinstance(end, StopIteration):
                return None
            raise


Perform = Callable[[RunningScript, Do, int], object]
"""A function that makes a call of a script at a time: it returns the result, or `LATER`."""


class ScriptScheduler:
    """Scripts side by side, in one fixed order, at times that are given. Mutable.

    A sleeping script resumes in the first run at or after its time. A script whose call is answered later
    resumes after those that are already ready.

    Args:
        scripts: the scripts by name, in the order in which they run at one instant.
        perform: makes the calls; a `RobotConnectionError` that it raises is raised in the script.
        collect: called before and after each turn of a script; answers the calls whose results have arrived.
    """

    def __init__(
        self,
        scripts: Mapping[str, Script],
        perform: Perform,
        collect: Callable[[], object] = lambda: None,
    ) -> None:
        self._perform, self._collect = perform, collect
        self._scripts = {name: RunningScript(name=name, script=script) for name, script in scripts.items()}
        self._sleeping: list[tuple[int, int, RunningScript]] = []
        self._sleep_count = 0
        self._ready = deque[tuple[RunningScript, object, Exception | None]](
            (running, None, None) for running in self._scripts.values()
        )

    def has_ended(self, name: str) -> bool:
        """Return True if a script has reached its end."""
        return self._scripts[name].has_ended

    @property
    def due_ns(self) -> int | None:
        """The time at which the next sleeping script resumes; None if none sleeps."""
        return self._sleeping[0][0] if self._sleeping else None

    def answer(self, running: RunningScript, value: object, problem: Exception | None = None) -> None:
        """Make a script ready whose call was to be answered later: by a result, or by `problem`."""
        self._ready.append((running, value, problem))

    def run(self, now_ns: int) -> None:
        """Resume the scripts that are due, until all sleep, wait or have ended.

        Raises:
            ScriptError: a script raised an exception.
        """
        sleeping, ready = self._sleeping, self._ready
        while sleeping and sleeping[0][0] <= now_ns:
            ready.append((heapq.heappop(sleeping)[2], now_ns, None))
        self._collect()
        while ready:
            running, value, problem = ready.popleft()
            try:
                self._resume(running, value, problem, now_ns)
            except Exception as raised:
                raise ScriptError(running.name, raised) from raised
            self._collect()

    def close(self) -> None:
        """Close all scripts."""
        for running in self._scripts.values():
            running.script.close()

    def _resume(self, running: RunningScript, value: object, problem: Exception | None, now_ns: int) -> None:
        for _ in range(MAX_STEPS_PER_INSTANT):
            step, problem = running.next(value, problem), None
            if step is None:
                return
            if isinstance(step, Do):
                try:
                    value = self._perform(running, step, now_ns)
                except RobotConnectionError as refused:
                    value, problem = None, refused
                if value is LATER:
                    return
            elif step.seconds > 0:
                self._sleep_count += 1
                due_ns = now_ns + round(step.seconds * 1e9)
                heapq.heappush(self._sleeping, (due_ns, self._sleep_count, running))
                return
            else:
                value = now_ns
        running.has_ended = True
        raise RuntimeError(f"{MAX_STEPS_PER_INSTANT} calls without a `sleep` or a wait between them")
