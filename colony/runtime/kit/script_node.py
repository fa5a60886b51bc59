"""A script (`script.py`) as a node among the servers of a run in virtual time."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

from colony.runtime.kit.conversation import (
    TIMEOUT_S,
    Conversation,
    Deliver,
    Listen,
    Outcome,
    Pending,
    Resolve,
    Transmit,
    answer_timeout,
    read_result,
)
from colony.runtime.kit.conversation import Effect as ConversationEffect
from colony.runtime.kit.errors import CallTimeoutError, RobotConnectionError, ServerNotFoundError
from colony.runtime.kit.script import Do, Script, Sleep
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Effect, Message, Notice, Reply, SendMessage, Wake, WakeAt

POLL_INTERVAL_NS = 100_000_000
"""Nanoseconds between two calls of `poll` of the connections."""

USER = "scripts"


class ScriptNode:
    """A node that runs a script, with a connection to each of its servers. Mutable.

    Args:
        name: the name of the script and of each of its connections.
        script: a generator that has not been started.
        servers: the servers that it may call.
        priority: the priority of its connections.
        delay_ns: delay from the start of the node to the start of the script. Servers read their devices at
            the start of a frame, so a script that starts slightly later sees the new readings.
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
        self._conversations = {
            server: Conversation(
                server=server,
                user=USER,
                new_id=partial("{}.{}".format, name, server),
                name=name,
                priority=priority,
                default_right="command",
            )
            for server in servers
        }
        self.listens = tuple(topics.replies(server, f"{USER}/{name}.{server}") for server in servers)
        self._started = False
        self._wake_ns: int | None = None
        self._pending_call: tuple[int, Pending, str, float] | None = None
        self._answer: Outcome | None = None
        self._next_poll_ns = 0

    def start(self, now_ns: int) -> Iterator[Effect]:
        """Open the connections and schedule the script's start."""
        for server, conversation in self._conversations.items():
            yield from self._carry_out(server, conversation.open(_ignore, now_ns), now_ns)
        self._wake_ns = now_ns + self._delay_ns
        self._next_poll_ns = now_ns + POLL_INTERVAL_NS
        yield WakeAt(self._wake_ns)
        yield WakeAt(self._next_poll_ns)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Handle a reply or a wake, and resume the script."""
        match message:
            case Reply() | Notice():
                for server, conversation in self._conversations.items():
                    yield from self._carry_out(server, conversation.receive(message, now_ns), now_ns)
            case Wake():
                yield from self._on_wake(now_ns)
            case _:
                return
        yield from self._continue(now_ns)

    def close(self) -> None:
        """End the script where it is."""
        self._script.close()

    # --- the script ------------------------------------------------------------------------------------

    def _continue(self, now_ns: int) -> Iterator[Effect]:
        """Resume the script as long as its answer has arrived or its sleep is over."""
        while not self.ended:
            if self._wake_ns is not None and now_ns >= self._wake_ns:
                resumed, self._started, self._wake_ns = self._started, True, None
                yield from self._resume(now_ns if resumed else None, None, now_ns)
            elif self._pending_call is not None and self._answer is not None:
                (_, pending, server, _), self._pending_call = self._pending_call, None
                outcome, self._answer = self._answer, None
                try:
                    value = read_result(server, pending.call, outcome)
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
            case Do(server=server, call=call):
                yield from self._call(server, call, now_ns)

    def _call(self, server: str, call: Any, now_ns: int) -> Iterator[Effect]:
        conversation = self._conversations.get(server)
        if conversation is None:
            available = ", ".join(self._conversations)
            problem = ServerNotFoundError(
                f"{self.address} has no connection to `{server}`; it has {available}"
            )
            yield from self._resume(None, problem, now_ns)
            return
        wait_s = answer_timeout(call, None, TIMEOUT_S)
        pending = Pending(call, self._on_outcome)
        due_ns = now_ns + round(min(wait_s, 1e9) * 1e9)
        self._pending_call = (due_ns, pending, server, wait_s)
        yield from self._carry_out(server, conversation.submit(pending, now_ns), now_ns)

    def _on_outcome(self, outcome: Outcome) -> None:
        self._answer = outcome

    def _end(self, now_ns: int) -> Iterator[Effect]:
        self.ended = True
        for server, conversation in self._conversations.items():
            yield from self._carry_out(server, conversation.close(now_ns), now_ns)

    # --- connections -----------------------------------------------------------------------------------

    def _on_wake(self, now_ns: int) -> Iterator[Effect]:
        if self.ended or now_ns < self._next_poll_ns:
            return
        self._next_poll_ns = now_ns + POLL_INTERVAL_NS
        yield WakeAt(self._next_poll_ns)
        for server, conversation in self._conversations.items():
            yield from self._carry_out(server, conversation.poll(now_ns), now_ns)
        if self._pending_call is not None and self._answer is None and now_ns >= self._pending_call[0]:
            _, pending, server, wait_s = self._pending_call
            self._conversations[server].forget(pending)
            self._answer = CallTimeoutError(
                f"{server} did not answer `{pending.call.method}` in {wait_s:g} s"
            )

    def _carry_out(self, server: str, effects: Iterator[ConversationEffect], now_ns: int) -> Iterator[Effect]:
        for effect in effects:
            match effect:
                case Transmit(message=message):
                    yield SendMessage(topics.calls(server), message)
                case Resolve(pending=pending, outcome=outcome):
                    pending.resolve(outcome)
                case Listen() | Deliver():
                    pass


def _ignore(outcome: Outcome) -> None:
    """Ignore an outcome."""
