"""A script (`script.py`) as a node among the servers of a run in virtual time."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

from colony.runtime.kit.answers import TIMEOUT_S, read_result, waiting_time
from colony.runtime.kit.conversation import Begin, Conversation, Outcome, Pending, Resolve, Tell, Transmit
from colony.runtime.kit.conversation import Effect as Said
from colony.runtime.kit.errors import CallTimeoutError, RobotConnectionError, ServerNotFoundError
from colony.runtime.kit.script import Do, Script, Sleep
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Effect, Message, Notice, Reply, Send, Wake, WakeAt

TEND_NS = 100_000_000
"""Nanoseconds between two calls of `tend` of the connections."""

USER = "scripts"


class ScriptNode:
    """A node that runs a script, with a connection to each of its servers. Mutable: the script's progress.

    Args:
        name: the name of the script and of each of its connections.
        script: a generator that has not begun.
        servers: the servers that it may call.
        priority: the priority of its connections.
        delay_ns: delay from the node's start to the script's. Servers observe the world at the beginning of a
            frame, so a script that starts a moment later knows what they observed.
    """

    def __init__(
        self,
        name: str,
        script: Script,
        servers: tuple[str, ...],
        *,
        priority: int = 0,
        delay_ns: int = 0,
    ) -> None:
        self.address = f"{USER}/{name}"
        self.ended = False
        self.problem: Exception | None = None
        self._script = script
        self._delay_ns = delay_ns
        self._talks = {
            server: Conversation(
                server=server,
                user=USER,
                ids=partial("{}.{}".format, name, server),
                name=name,
                priority=priority,
                least="command",
            )
            for server in servers
        }
        self.listens = tuple(topics.replies(server, f"{USER}/{name}.{server}") for server in servers)
        self._begun = False
        self._wake_ns: int | None = None
        self._due: tuple[int, Pending, str, float] | None = None
        self._answer: Outcome | None = None
        self._tend_ns = 0

    def start(self, now_ns: int) -> Iterator[Effect]:
        """Open the connections and schedule the script's start."""
        for server, talk in self._talks.items():
            yield from self._say(server, talk.open(_ignore, now_ns), now_ns)
        self._wake_ns = now_ns + self._delay_ns
        self._tend_ns = now_ns + TEND_NS
        yield WakeAt(self._wake_ns)
        yield WakeAt(self._tend_ns)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Handle a reply or an alarm, and resume the script."""
        match message:
            case Reply() | Notice():
                for server, talk in self._talks.items():
                    yield from self._say(server, talk.take(message, now_ns), now_ns)
            case Wake():
                yield from self._woken(now_ns)
            case _:
                return
        yield from self._go_on(now_ns)

    def close(self) -> None:
        """End the script where it is."""
        self._script.close()

    # --- the script ------------------------------------------------------------------------------------

    def _go_on(self, now_ns: int) -> Iterator[Effect]:
        """Resume the script for as long as it has an answer or its time has come."""
        while not self.ended:
            if self._wake_ns is not None and now_ns >= self._wake_ns:
                begun, self._begun, self._wake_ns = self._begun, True, None
                yield from self._resume(now_ns if begun else None, None, now_ns)
            elif self._due is not None and self._answer is not None:
                (_, pending, server, _), self._due = self._due, None
                outcome, self._answer = self._answer, None
                try:
                    value = read_result(server, pending.ask, outcome)
                except RobotConnectionError as problem:
                    yield from self._resume(None, problem, now_ns)
                else:
                    yield from self._resume(value, None, now_ns)
            else:
                return

    def _resume(self, value: Any, problem: Exception | None, now_ns: int) -> Iterator[Effect]:
        try:
            step = self._script.send(value) if problem is None else self._script.throw(problem)
        except StopIteration:
            yield from self._end(now_ns)
            return
        except Exception as raised:
            self.problem = raised
            yield from self._end(now_ns)
            return
        match step:
            case Sleep(seconds=seconds):
                self._wake_ns = now_ns + max(0, round(seconds * 1e9))
                if self._wake_ns > now_ns:
                    yield WakeAt(self._wake_ns)
            case Do(server=server, ask=ask):
                yield from self._ask(server, ask, now_ns)

    def _ask(self, server: str, ask: Any, now_ns: int) -> Iterator[Effect]:
        talk = self._talks.get(server)
        if talk is None:
            known = ", ".join(self._talks)
            problem = ServerNotFoundError(f"{self.address} has no connection to `{server}`; it has {known}")
            yield from self._resume(None, problem, now_ns)
            return
        wait_s = waiting_time(ask, None, TIMEOUT_S)
        pending = Pending(ask, self._resolved)
        due_ns = now_ns + round(min(wait_s, 1e9) * 1e9)
        self._due = (due_ns, pending, server, wait_s)
        yield from self._say(server, talk.ask(pending, now_ns), now_ns)

    def _resolved(self, outcome: Outcome) -> None:
        self._answer = outcome

    def _end(self, now_ns: int) -> Iterator[Effect]:
        self.ended = True
        for server, talk in self._talks.items():
            yield from self._say(server, talk.close(now_ns), now_ns)

    # --- connections -----------------------------------------------------------------------------------

    def _woken(self, now_ns: int) -> Iterator[Effect]:
        if self.ended or now_ns < self._tend_ns:
            return
        self._tend_ns = now_ns + TEND_NS
        yield WakeAt(self._tend_ns)
        for server, talk in self._talks.items():
            yield from self._say(server, talk.tend(now_ns), now_ns)
        if self._due is not None and self._answer is None and now_ns >= self._due[0]:
            _, pending, server, wait_s = self._due
            self._talks[server].forget(pending)
            self._answer = CallTimeoutError(f"{server} did not answer `{pending.ask.method}` in {wait_s:g} s")

    def _say(self, server: str, said: Iterator[Said], now_ns: int) -> Iterator[Effect]:
        for effect in said:
            match effect:
                case Transmit(message=message):
                    yield Send(topics.calls(server), message)
                case Resolve(pending=pending, outcome=outcome):
                    pending.resolve(outcome)
                case Begin() | Tell():
                    pass


def _ignore(outcome: Outcome) -> None:
    """Ignore an outcome."""
