"""Scripts (`runtime/kit/script.py`) among the servers of this process, each moment in one fixed order.

A script that sleeps goes on in the first frame at or after the time that it asked for; one that waits for a
semaphore, in the very moment in which somebody signals it, behind those that are ready already.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from colony.experiment.local_servers import LocalServer, answer
from colony.runtime.kit.errors import CallRefused, ServerNotFound
from colony.runtime.kit.script import Do, Script, Sleep
from colony.runtime.protocol.calls import LATER, Asked, Refused
from colony.runtime.protocol.connections import Caller

STEPS_IN_A_MOMENT = 20_000
"""A script that does more than this without any time passing does not end by itself."""


class ScriptFailed(Exception):
    """A script raised; `__cause__` is what."""

    def __init__(self, name: str, problem: BaseException) -> None:
        super().__init__(f"the script `{name}` raised {type(problem).__name__}: {problem}")
        self.name = name


@dataclass(frozen=False, slots=True, kw_only=True, eq=False)
class _Running:
    name: str
    script: Script
    caller: Caller
    calls: int = 0
    ended: bool = False


class LocalScripts:
    """Runs scripts. Mutable: where each is.

    Args:
        scripts: by name, in the order in which they are run in a moment.
        servers: whom they may ask.
    """

    def __init__(self, scripts: Mapping[str, Script], servers: Iterable[LocalServer]) -> None:
        self._servers = {server.address: server for server in servers}
        self._all = {
            name: _Running(name=name, script=script, caller=Caller(f"local/{name}", name, 0, "local"))
            for name, script in scripts.items()
        }
        self._sleeping: list[tuple[int, int, _Running]] = []
        self._waiting: dict[Asked, _Running] = {}
        self._ready: deque[tuple[_Running, object, Exception | None]] = deque(
            (running, None, None) for running in self._all.values()
        )
        self._slept = 0

    def ended(self, name: str) -> bool:
        """Whether a script has come to its end."""
        return self._all[name].ended

    def run(self, now_ns: int) -> None:
        """Let everybody go on whose time has come, until all sleep, wait or have ended.

        Raises:
            ScriptFailed: one raised.
        """
        sleeping, ready = self._sleeping, self._ready
        while sleeping and sleeping[0][0] <= now_ns:
            ready.append((heapq.heappop(sleeping)[2], now_ns, None))
        self._collect()
        while ready:
            running, value, problem = ready.popleft()
            self._go_on(running, value, problem, now_ns)
            self._collect()

    def close(self) -> None:
        """End all scripts."""
        for running in self._all.values():
            running.script.close()

    def _collect(self) -> None:
        """Those who waited and have their answer."""
        for server in self._servers.values():
            if server.granted:
                for asked, refused in server.granted:
                    running = self._waiting.pop(asked)
                    self._ready.append((running, None, None if refused is None else _raised(refused)))
                server.granted.clear()

    def _go_on(self, running: _Running, value: object, problem: Exception | None, now_ns: int) -> None:
        script = running.script
        try:
            for _ in range(STEPS_IN_A_MOMENT):
                step = script.send(value) if problem is None else script.throw(problem)
                value = problem = None
                if isinstance(step, Sleep):
                    if step.seconds > 0:
                        self._slept += 1
                        due_ns = now_ns + round(step.seconds * 1e9)
                        heapq.heappush(self._sleeping, (due_ns, self._slept, running))
                        return
                    value = now_ns
                else:
                    running.calls += 1
                    asked = Asked(running.caller, running.calls)
                    try:
                        value = self._do(step, asked, now_ns)
                    except (CallRefused, ServerNotFound) as refused:
                        problem = refused
                    if value is LATER:
                        self._waiting[asked] = running
                        return
            raise RuntimeError(f"{STEPS_IN_A_MOMENT} calls without a `sleep` or a wait between them")
        except StopIteration:
            running.ended = True
        except Exception as raised:
            running.ended = True
            raise ScriptFailed(running.name, raised) from raised

    def _do(self, step: Do, asked: Asked, now_ns: int) -> Any:
        server = self._servers.get(step.server)
        if server is None:
            known = ", ".join(self._servers)
            raise ServerNotFound(f"there is no server `{step.server}` in this run; there is {known}")
        try:
            return answer(server, asked, step.ask, now_ns)
        except Refused as refused:
            raise _raised(refused) from None


def _raised(refused: Refused) -> CallRefused:
    return CallRefused(refused.problem.code, refused.problem.message)
