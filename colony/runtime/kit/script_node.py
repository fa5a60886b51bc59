"""A script (`script.py`) as a node among the servers of a run in virtual time."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

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
from colony.runtime.kit.script import Do, RunningScript, Script, ScriptError, ScriptScheduler
from colony.runtime.protocol import topics
from colony.runtime.protocol.calls import LATER
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
        self.problem: Exception | None = None
        self._name = name
        self._scripts = ScriptScheduler({name: script}, self._call)
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
        self._start_ns = self._wake_ns = 0
        self._waiting: _Waiting | None = None
        self._effects: list[Effect] = []
        self._next_poll_ns = 0

    @property
    def ended(self) -> bool:
        """True if the script has reached its end, or raised an exception."""
        return self._scripts.has_ended(self._name)

    def start(self, now_ns: int) -> Iterator[Effect]:
        """Open the connections and schedule the script's start."""
        for server, conversation in self._conversations.items():
            yield from self._carry_out(server, conversation.open(_ignore, now_ns))
        self._start_ns = self._wake_ns = now_ns + self._delay_ns
        self._next_poll_ns = now_ns + POLL_INTERVAL_NS
        yield WakeAt(self._start_ns)
        yield WakeAt(self._next_poll_ns)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Handle a reply or a wake, and resume the script."""
        match message:
            case Reply() | Notice():
                for server, conversation in self._conversations.items():
                    yield from self._carry_out(server, conversation.receive(message, now_ns))
            case Wake():
                yield from self._on_wake(now_ns)
            case _:
                return
        if not self.ended and now_ns >= self._start_ns:
            yield from self._continue(now_ns)

    def close(self) -> None:
        """End the script where it is."""
        self._scripts.close()

    # --- the script ------------------------------------------------------------------------------------

    def _continue(self, now_ns: int) -> Iterator[Effect]:
        """Resume the script if its answer has arrived or its sleep is over."""
        try:
            self._scripts.run(now_ns)
        except ScriptError as failure:
            self.problem = failure.problem
        effects, self._effects = self._effects, []
        yield from effects
        if self.ended:
            for server, conversation in self._conversations.items():
                yield from self._carry_out(server, conversation.close(now_ns))
        elif (due_ns := self._scripts.due_ns) is not None and due_ns != self._wake_ns:
            self._wake_ns = due_ns
            yield WakeAt(due_ns)

    def _call(self, running: RunningScript, step: Do, now_ns: int) -> object:
        server, call = step
        conversation = self._conversations.get(server)
        if conversation is None:
            available = ", ".join(self._conversations)
            raise ServerNotFoundError(f"{self.address} has no connection to `{server}`; it has {available}")
        wait_s = answer_timeout(call, None, TIMEOUT_S)
        pending = Pending(call, partial(self._on_outcome, running, step))
        self._waiting = _Waiting(now_ns + round(min(wait_s, 1e9) * 1e9), pending, server, wait_s)
        self._effects += self._carry_out(server, conversation.submit(pending, now_ns))
        return LATER

    def _on_outcome(self, running: RunningScript, step: Do, outcome: Outcome) -> None:
        self._waiting = None
        try:
            self._scripts.answer(running, read_result(step.server, step.call, outcome))
        except RobotConnectionError as problem:
            self._scripts.answer(running, None, problem)

    # --- connections -----------------------------------------------------------------------------------

    def _on_wake(self, now_ns: int) -> Iterator[Effect]:
        if self.ended or now_ns < self._next_poll_ns:
            return
        self._next_poll_ns = now_ns + POLL_INTERVAL_NS
        yield WakeAt(self._next_poll_ns)
        for server, conversation in self._conversations.items():
            yield from self._carry_out(server, conversation.poll(now_ns))
        if (waiting := self._waiting) is not None and now_ns >= waiting.due_ns:
            self._conversations[waiting.server].forget(waiting.pending)
            method = waiting.pending.call.method
            waiting.pending.resolve(
                CallTimeoutError(f"{waiting.server} did not answer `{method}` in {waiting.wait_s:g} s")
            )

    def _carry_out(self, server: str, effects: Iterator[ConversationEffect]) -> Iterator[Effect]:
        for effect in effects:
            match effect:
                case Transmit(message=message):
                    yield SendMessage(topics.calls(server), message)
                case Resolve(pending=pending, outcome=outcome):
                    pending.resolve(outcome)
                case Listen() | Deliver():
                    pass


class _Waiting(NamedTuple):
    """The call whose answer the script waits for, until `due_ns`."""

    due_ns: int
    pending: Pending
    server: str
    wait_s: float


def _ignore(outcome: Outcome) -> None:
    """Ignore an outcome."""
