"""A conversation over the network, shared by the blocking and the asyncio connections.

Network threads and user threads meet here under one lock, which is never held during a send: a send may wait
for room, and the thread that makes room may need the lock.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from threading import Lock
from typing import Any

import zenoh

from colony.runtime.kit.conversation import (
    Begin,
    Conversation,
    Effect,
    Outcome,
    Pending,
    Resolve,
    State,
    Tell,
    Transmit,
)
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.library.ask import Ask
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.messages import Alive, Call, Notice, Reply, Right
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.outbox import haste_of, publish

monotonic = time.monotonic_ns

Deferred = Callable[[], None]


class _Publisher:
    """A publisher that one thread may release while another one sends. Mutable: whether it is released."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self._publisher = publisher
        self._lock = Lock()

    def put(self, data: bytes) -> None:
        with self._lock:
            self._publisher.put(data)

    def release(self) -> None:
        """Undeclare the publisher, unless another thread is sending: then its last reference does."""
        if self._lock.acquire(blocking=False):
            self._publisher.undeclare()  # type: ignore[no-untyped-call]
            self._lock.release()


class Wire:
    """A conversation over the network. Mutable: the conversation and its publishers."""

    def __init__(
        self,
        network: ZenohSession,
        server: str,
        *,
        name: str,
        priority: int,
        rights: tuple[Right, ...],
        ids: Callable[[], str],
        begin: Callable[[Wire, str], None],
        notify: Callable[[Notice], None],
        defer: Callable[[Deferred], None],
    ) -> None:
        """Create a conversation that is not open yet.

        Args:
            network: the session to send with.
            server: the name of the server.
            name: the name of the connection, for people.
            priority: the priority of all its calls.
            rights: the user's rights.
            ids: returns a new id every time.
            begin: takes the connection whose replies have to be passed to `take` from now on.
            notify: takes the server's notices.
            defer: takes work that must not be done in a network thread, for another thread to do soon.
        """
        self.server = server
        self.network = network
        self._rights = rights
        self._begin = begin
        self._notify = notify
        self._defer = defer
        self._lock = Lock()
        self._least = rights[0]
        self._talk = Conversation(
            server=server,
            user=network.user,
            ids=ids,
            name=name,
            priority=priority,
            least=self._least,
        )
        self._publishers: dict[tuple[str, bool], _Publisher] = {}

    # --- for connections -----------------------------------------------------------------------------

    def open(self, resolve: Callable[[Outcome], None]) -> None:
        """Open the connection; `resolve` is called with the outcome."""
        with self._lock:
            effects = list(self._talk.open(resolve, monotonic()))
        self._carry_out(effects)

    def submit(self, ask: Ask[Any], resolve: Callable[[Outcome], None]) -> Pending:
        """Make a call; `resolve` is called with its outcome, from any thread.

        Raises:
            CallRefusedError: the user does not have the right to this call.
        """
        if ask.right != "read" and ask.right not in self._rights:
            raise CallRefusedError("right", self._not_allowed(ask))
        pending = Pending(ask, resolve)
        with self._lock:
            effects = list(self._talk.ask(pending, monotonic()))
        self._carry_out(effects)
        return pending

    def again(self, pending: Pending) -> None:
        """Send a call without an answer again."""
        with self._lock:
            effects = list(self._talk.again(pending, monotonic()))
        self._carry_out(effects, patient=False)

    def forget(self, pending: Pending) -> None:
        """Drop a call whose answer is no longer awaited."""
        with self._lock:
            self._talk.forget(pending)

    def keep(self, ask: Ask[Any]) -> None:
        """Make this call again whenever the connection is reopened."""
        with self._lock:
            self._talk.keep(ask)

    def close(self) -> None:
        """Notify the server, and close."""
        with self._lock:
            effects = list(self._talk.close(monotonic()))
        self._carry_out(effects)
        self._release()

    @property
    def complaint(self) -> str:
        """The server's newest error that belongs to no call, such as why it refuses the connection."""
        return self._talk.complaint

    @property
    def openings(self) -> int:
        """The number of times the connection was opened; above 1, it was lost in between."""
        return self._talk.openings

    @property
    def is_open(self) -> bool:
        """True if, as far as is known, the server has this connection."""
        return self._talk.state is State.OPEN

    # --- for the hub ---------------------------------------------------------------------------------

    def tend(self) -> None:
        """Resend calls that are due; called every 100 ms."""
        with self._lock:
            effects = list(self._talk.tend(monotonic()))
        self._carry_out(effects, patient=False)

    def presence(self, present: bool) -> None:
        """Handle the server's appearance on the network, or its loss."""
        with self._lock:
            talk = self._talk
            effects = list(talk.appeared(monotonic()) if present else talk.vanished())
        self._carry_out(effects, patient=False)

    # --- internals -----------------------------------------------------------------------------------

    def _carry_out(self, effects: Iterable[Effect], *, patient: bool = True) -> None:
        for effect in effects:
            match effect:
                case Transmit(message):
                    self._send(message, patient)
                case Resolve(pending, outcome):
                    pending.resolve(outcome)
                case Tell(notice):
                    self._notify(notice)
                case Begin(connection):
                    self._begin(self, connection)

    def _release(self) -> None:
        publishers, self._publishers = self._publishers, {}
        for publisher in publishers.values():
            publisher.release()

    def take(self, message: Reply | Notice) -> None:
        """Handle a reply of the server, in a network thread."""
        with self._lock:
            effects = list(self._talk.take(message, monotonic()))
        at_once = [e for e in effects if isinstance(e, (Resolve, Tell))]
        if len(at_once) < len(effects):
            later = [e for e in effects if not isinstance(e, (Resolve, Tell))]
            self._defer(lambda: self._carry_out(later, patient=False))
        self._carry_out(at_once)

    def _send(self, message: Call | Alive, patient: bool) -> None:
        """Send a message; if not `patient`, drop it rather than wait for room."""
        network, topic = self.network, topics.calls(self.server)
        key = keys.sending(network.robot, topic, message, user=network.user, least=self._least)
        publisher = self._publishers.get((key, patient))
        with suppress(zenoh.ZError):  # the id is released already, so the message is obsolete
            if publisher is None:
                made = publish(self.network.session, key, haste=haste_of(message), patient=patient)
                publisher = self._publishers[key, patient] = _Publisher(made)
            publisher.put(codec.encode(message))

    def _not_allowed(self, ask: Ask[Any]) -> str:
        may = ", ".join(self._rights)
        return (
            f"{self.server}.{ask.method} needs the right to {ask.right}, and {self.network.user} may only "
            f"{may}: the table of users of the gateway says so"
        )
