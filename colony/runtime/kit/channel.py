"""A conversation over the network, used by both the blocking and the asyncio connections.

Network threads and user threads share one lock, which is never held during a send: a send may wait for space
in a buffer, and the thread that frees the space may need the lock.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from threading import Lock
from typing import Any

import zenoh

from colony.runtime.kit.conversation import (
    Conversation,
    ConversationState,
    Deliver,
    Effect,
    Listen,
    Outcome,
    Pending,
    Resolve,
    Transmit,
)
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.calls import right_text
from colony.runtime.protocol.messages import Alive, Call, Notice, Reply, Right
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.network import ZenohSession, require_threads
from colony.runtime.transport.live.outbox import declare_publisher, priority_of

monotonic = time.monotonic_ns

Deferred = Callable[[], None]


class _Publisher:
    """A publisher that one thread may release while another sends. Mutable."""

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


class Channel:
    """A conversation (`conversation.py`) with a server over the network. Mutable."""

    def __init__(
        self,
        network: ZenohSession,
        server: str,
        *,
        name: str,
        priority: int,
        rights: tuple[Right, ...],
        new_id: Callable[[], str],
        register: Callable[[Channel, str], None],
        notify: Callable[[Notice], None],
        defer: Callable[[Deferred], None],
    ) -> None:
        """Create a channel that is not open yet.

        Args:
            network: the session to send with.
            server: the name of the server.
            name: the display name of the connection.
            priority: the priority of all its calls.
            rights: the user's rights.
            new_id: function that returns a new id each time.
            register: called with the connection whose replies must be passed to `receive` from now on.
            notify: called with each notice of the server.
            defer: runs work in another thread, for work that must not run in a network thread.
        """
        self.server = server
        self.network = network
        self._rights = rights
        self._register = register
        self._notify = notify
        self._defer = defer
        self._lock = Lock()
        self._default_right = rights[0]
        self._conversation = Conversation(
            server=server,
            user=network.user,
            new_id=new_id,
            name=name,
            priority=priority,
            default_right=self._default_right,
        )
        self._publishers: dict[tuple[str, bool], _Publisher] = {}

    # --- for connections -----------------------------------------------------------------------------

    def open(self, resolve: Callable[[Outcome], None]) -> None:
        """Open the connection; `resolve` is called with the outcome.

        Raises:
            ForkedError: this process was forked after its session was opened.
        """
        require_threads()
        with self._lock:
            effects = list(self._conversation.open(resolve, monotonic()))
        self._carry_out(effects)

    def submit(self, call: CallRequest[Any], resolve: Callable[[Outcome], None]) -> Pending:
        """Make a call; `resolve` is called with its outcome, from any thread.

        Raises:
            CallRefusedError: the user does not have the right to this call.
            ForkedError: this process was forked after its session was opened.
        """
        require_threads()
        if call.right != "read" and call.right not in self._rights:
            raise CallRefusedError("right", self._not_allowed(call))
        pending = Pending(call, resolve)
        with self._lock:
            effects = list(self._conversation.submit(pending, monotonic()))
        self._carry_out(effects)
        return pending

    def resend(self, pending: Pending) -> None:
        """Resend a call that has no answer yet."""
        with self._lock:
            effects = list(self._conversation.resend(pending, monotonic()))
        self._carry_out(effects, may_block=False)

    def forget(self, pending: Pending) -> None:
        """Drop a call whose answer is no longer awaited."""
        with self._lock:
            self._conversation.forget(pending)

    def repeat_on_reopen(self, call: CallRequest[Any]) -> None:
        """Make this call again whenever the connection is reopened."""
        with self._lock:
            self._conversation.repeat_on_reopen(call)

    def close(self) -> None:
        """Close the connection, and notify the server."""
        with self._lock:
            effects = list(self._conversation.close(monotonic()))
        self._carry_out(effects)
        self._release()

    @property
    def server_error(self) -> str:
        """The server's newest error without a call, such as the reason why it refuses the connection."""
        return self._conversation.server_error

    @property
    def openings(self) -> int:
        """The number of times that the connection was opened; above 1, it was lost in between."""
        return self._conversation.openings

    @property
    def is_open(self) -> bool:
        """True if, as far as is known, the server has this connection."""
        return self._conversation.state is ConversationState.OPEN

    # --- for the hub ---------------------------------------------------------------------------------

    def poll(self) -> None:
        """Resend calls that are due; called every 100 ms."""
        with self._lock:
            effects = list(self._conversation.poll(monotonic()))
        self._carry_out(effects, may_block=False)

    def on_presence(self, present: bool) -> None:
        """Handle the server's appearance on the network, or its loss."""
        with self._lock:
            conversation = self._conversation
            effects = list(conversation.server_found(monotonic()) if present else conversation.server_lost())
        self._carry_out(effects, may_block=False)

    # --- internals -----------------------------------------------------------------------------------

    def _carry_out(self, effects: Iterable[Effect], *, may_block: bool = True) -> None:
        for effect in effects:
            match effect:
                case Transmit(message):
                    self._send(message, may_block)
                case Resolve(pending, outcome):
                    pending.resolve(outcome)
                case Deliver(notice):
                    self._notify(notice)
                case Listen(connection):
                    self._register(self, connection)

    def _release(self) -> None:
        publishers, self._publishers = self._publishers, {}
        for publisher in publishers.values():
            publisher.release()

    def receive(self, message: Reply | Notice) -> None:
        """Handle a reply of the server, in a network thread."""
        with self._lock:
            effects = list(self._conversation.receive(message, monotonic()))
        at_once = [e for e in effects if isinstance(e, (Resolve, Deliver))]
        if len(at_once) < len(effects):
            later = [e for e in effects if not isinstance(e, (Resolve, Deliver))]
            self._defer(lambda: self._carry_out(later, may_block=False))
        self._carry_out(at_once)

    def _send(self, message: Call | Alive, may_block: bool) -> None:
        """Send a message; without `may_block`, drop it rather than wait for space in the send buffer."""
        network, topic = self.network, topics.calls(self.server)
        key = keys.publication_key(
            network.robot, topic, message, user=network.user, alive_right=self._default_right
        )
        publisher = self._publishers.get((key, may_block))
        with suppress(zenoh.ZError):  # the connection is released already, so the message is obsolete
            if publisher is None:
                zenoh_publisher = declare_publisher(
                    self.network.session, key, priority=priority_of(message), may_block=may_block
                )
                publisher = self._publishers[key, may_block] = _Publisher(zenoh_publisher)
            publisher.put(codec.encode(message))

    def _not_allowed(self, call: CallRequest[Any]) -> str:
        may = ", ".join(map(right_text, self._rights))
        return (
            f"{self.server}.{call.method} needs the right to {right_text(call.right)}, and "
            f"{self.network.user} may only {may}, according to the gateway's table of users"
        )
