"""Scripts (`script.py`) that call the methods of servers in the same process, in one fixed order.

Calls go directly to the methods of the servers, without messages, connections or a store, and are answered
immediately. A sleeping script resumes in the first frame at or after its time. A script that waits for a
semaphore resumes as soon as it is signaled, after the scripts that are already ready.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import msgspec

from colony.runtime.kit.errors import CallRefusedError, ServerNotFoundError
from colony.runtime.kit.script import Do, Script, Sleep
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import LATER, CallId, Handler, Method, RefusedError
from colony.runtime.protocol.connections import Caller

MAX_STEPS_PER_INSTANT = 20_000
"""Maximum number of steps of a script at one instant; beyond it, the script is taken to loop forever."""


class ScriptError(Exception):
    """An exception raised by a script, which is the `__cause__`."""

    def __init__(self, name: str, problem: BaseException) -> None:
        super().__init__(f"the script `{name}` raised {type(problem).__name__}: {problem}")
        self.name = name


class LocalServer:
    """A server that is called in this process. Mutable.

    `handlers` are its methods by name.

    Args:
        address: the name of the server.
        methods: all methods of the server.
        answers: results, or refusals, of calls that returned `LATER`; the scripts' runner empties the list.
    """

    def __init__(
        self,
        address: str,
        methods: Iterable[Method],
        answers: list[tuple[CallId, object]] | None = None,
    ) -> None:
        self.address = address
        self.answers = [] if answers is None else answers
        self.handlers: Mapping[str, Handler] = {m.name: m.handler for m in methods}

    def do(self, call_id: CallId, call: CallRequest[Any], now_ns: int) -> Any:
        """Return the result of a call, or `LATER` if the call has to wait.

        Raises:
            RefusedError: the server refuses the call.
        """
        handler = self.handlers.get(call.method)
        if handler is None:
            available = ", ".join(sorted(self.handlers))
            raise RefusedError(
                "method", f"{self.address} has no method `{call.method}` here; expected {available}"
            )
        result = handler(call_id, call.arguments, now_ns)
        if isinstance(result, msgspec.Raw):
            return _decoder(call.reply).decode(result)
        if isinstance(result, dict):
            decode = _decoder(Any).decode
            return {name: decode(value) for name, value in result.items()}
        return result


@lru_cache(maxsize=64)
def _decoder(reply: Any) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(reply)


@dataclass(frozen=False, slots=True, kw_only=True, eq=False)
class _RunningScript:
    name: str
    script: Script
    caller: Caller
    calls: int = 0
    has_ended: bool = False


class LocalScripts:
    """The scripts of this process. Mutable.

    Args:
        scripts: the scripts by name, in the order in which they run at one instant.
        servers: the servers that they may call.
    """

    def __init__(self, scripts: Mapping[str, Script], servers: Iterable[LocalServer]) -> None:
        self._servers = {server.address: server for server in servers}
        self._scripts = {
            name: _RunningScript(name=name, script=script, caller=Caller(f"local/{name}", name, 0, "local"))
            for name, script in scripts.items()
        }
        self._sleeping: list[tuple[int, int, _RunningScript]] = []
        self._waiting: dict[CallId, _RunningScript] = {}
        self._ready: deque[tuple[_RunningScript, object, Exception | None]] = deque(
            (running, None, None) for running in self._scripts.values()
        )
        self._sleep_count = 0

    def has_ended(self, name: str) -> bool:
        """Return True if a script has reached its end."""
        return self._scripts[name].has_ended

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
            self._resume(running, value, problem, now_ns)
            self._collect()

    def close(self) -> None:
        """Close all scripts."""
        for running in self._scripts.values():
            running.script.close()

    def _collect(self) -> None:
        """Make the waiting scripts ready whose answers have arrived."""
        if not self._waiting:
            return
        for server in self._servers.values():
            if server.answers:
                for call_id, result in server.answers:
                    refused = _call_refused(result) if isinstance(result, RefusedError) else None
                    self._ready.append((self._waiting.pop(call_id), None, refused))
                server.answers.clear()

    def _resume(self, running: _RunningScript, value: object, problem: Exception | None, now_ns: int) -> None:
        script = running.script
        try:
            for _ in range(MAX_STEPS_PER_INSTANT):
                step = script.send(value) if problem is None else script.throw(problem)
                value = problem = None
                if isinstance(step, Sleep):
                    if step.seconds > 0:
                        self._sleep_count += 1
                        due_ns = now_ns + round(step.seconds * 1e9)
                        heapq.heappush(self._sleeping, (due_ns, self._sleep_count, running))
                        return
                    value = now_ns
                else:
                    running.calls += 1
                    call_id = CallId(running.caller, running.calls)
                    try:
                        value = self._do(step, call_id, now_ns)
                    except (CallRefusedError, ServerNotFoundError) as refused:
                        problem = refused
                    if value is LATER:
                        self._waiting[call_id] = running
                        return
            raise RuntimeError(f"{MAX_STEPS_PER_INSTANT} calls without a `sleep` or a wait between them")
        except StopIteration:
            running.has_ended = True
        except Exception as raised:
            running.has_ended = True
            raise ScriptError(running.name, raised) from raised

    def _do(self, step: Do, call_id: CallId, now_ns: int) -> Any:
        server = self._servers.get(step.server)
        if server is None:
            available = ", ".join(self._servers)
            raise ServerNotFoundError(f"there is no server `{step.server}` in this run; it has {available}")
        try:
            return server.do(call_id, step.call, now_ns)
        except RefusedError as refused:
            raise _call_refused(refused) from None


def _call_refused(refused: RefusedError) -> CallRefusedError:
    return CallRefusedError(refused.problem.code, refused.problem.message)
