"""A process's outgoing messages, with a declared publisher per key: what nobody hears is not even encoded.

Ticks, server frames and verdicts go to all readers, and are dropped for a reader whose link is full, because
a frozen reader must not block the server; a reader fetches the frames that it missed. Other messages wait for
room if the outbox may block. Otherwise they are dropped, too: clients send new ones with the next frame, and
connections repeat the call.

Frame messages overtake checkpoints, calls and replies, which may contain whole images.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from enum import Enum

import zenoh

from colony.runtime.protocol import codec
from colony.runtime.protocol.messages import (
    MAX_BATCH_LENGTH,
    Alive,
    Batch,
    Batched,
    Call,
    Checkpoint,
    Notice,
    Problem,
    Ready,
    Reply,
    SendMessage,
    SentMessage,
    ServerFrame,
    Tick,
    Verdict,
    WireMessage,
)
from colony.runtime.transport.live import keys

IDLE_NS = 10_000_000_000
"""Nanoseconds without a message after which a connection's publisher is released."""

MAX_BATCHED_BYTES = 1024
"""Maximum size in bytes of a checkpoint that is sent in a batch."""

MAX_CONNECTION_PUBLISHERS = 256
"""Maximum number of publishers for connections."""

ToConnection = (Call, Alive, Reply, Notice)
"""The types of messages between a connection and a server."""

Report = Callable[[str], None]
"""A function that takes a sentence about each problem that the process survives."""


class Outbox:
    """The publishers of a process. Mutable."""

    def __init__(
        self,
        session: zenoh.Session,
        robot: str,
        report: Report,
        *,
        user: str,
        may_block: bool = True,
        urgent: bool = False,
        is_local: Callable[[str], bool] = lambda topic: False,
    ) -> None:
        """Create an outbox for one thread at a time.

        Args:
            session: session to send with.
            robot: robot whose processes receive the messages.
            report: callback for a sentence about each message that cannot be sent.
            user: user in the keys of messages that clients send.
            may_block: True to make messages that do not go to all readers wait for room instead of being
                dropped.
            urgent: True to let replies overtake all other messages; then no message waits for room.
            is_local: returns True for topics that nodes of this process listen to; they get messages in
                memory, and only other processes are sent any.
        """
        self._session = session
        self._robot = robot
        self._report = report
        self._user = user
        self._may_block = may_block and not urgent
        self._urgent = urgent
        self._is_local = is_local
        self._topic_publishers: dict[str, _TopicPublisher] = {}
        self._connection_publishers: dict[str, tuple[zenoh.Publisher, int]] = {}

    def send_all(self, sends: Iterable[SendMessage], now_ns: int) -> None:
        """Send messages: first the single ones, then messages of clients to the same server, in batches."""
        batches: dict[str, list[Batched]] = {}
        for topic, message in sends:
            if not self._is_heard(topic, message):
                continue
            if isinstance(message, Batched) and not _is_large(message):
                batches.setdefault(topic, []).append(message)
            else:
                self.send(topic, message, now_ns)
        for topic, messages in batches.items():
            for i in range(0, len(messages), MAX_BATCH_LENGTH):
                self._send_together(topic, messages[i : i + MAX_BATCH_LENGTH], now_ns)

    def send(self, topic: str, message: SentMessage, now_ns: int) -> None:
        """Send a message; report one that is too large, and send an error instead of a reply that is."""
        try:
            data = codec.encode(message)
        except ValueError as problem:
            self._report(f"to {topic}: {problem}")
            if not isinstance(message, Reply):
                return
            data = codec.encode(_too_large(message, str(problem)))
        self._put(topic, message, data, now_ns)

    def _send_together(self, topic: str, messages: Sequence[Batched], now_ns: int) -> None:
        """Send messages as one batch, or as several if they are too large for one."""
        if len(messages) == 1:
            self.send(topic, messages[0], now_ns)
            return
        batch = Batch(messages=tuple(messages))
        try:
            data = codec.encode(batch)
        except ValueError:
            half = len(messages) // 2
            self._send_together(topic, messages[:half], now_ns)
            self._send_together(topic, messages[half:], now_ns)
        else:
            self._put(topic, batch, data, now_ns)

    def _is_heard(self, topic: str, message: SentMessage) -> bool:
        """Return False if a message would be encoded for nobody."""
        if isinstance(message, ToConnection):
            return True
        try:
            return self._topic_publisher(topic, message).is_heard
        except zenoh.ZError as problem:  # a name given by a user is not valid in a key
            self._report(f"to {topic}: {problem}")
            return False

    def _put(self, topic: str, message: WireMessage, data: bytes, now_ns: int) -> None:
        try:
            self._publisher(topic, message, now_ns).put(data)
        except zenoh.ZError as problem:  # a name given by a user is not valid in a key
            self._report(f"to {topic}: {problem}")

    def _publisher(self, topic: str, message: WireMessage, now_ns: int) -> zenoh.Publisher:
        # the messages of a batch are of one kind
        first = message.messages[0] if isinstance(message, Batch) else message
        if isinstance(first, ToConnection):
            key = keys.publication_key(self._robot, topic, message, user=self._user)
            return self._connection_publisher(key, first, now_ns)
        return self._topic_publisher(topic, first).publisher

    def _topic_publisher(self, topic: str, message: SentMessage) -> _TopicPublisher:
        publisher = self._topic_publishers.get(topic)
        if publisher is None:
            priority = SendPriority.CALLS if keys.carries_memory(topic) else SendPriority.FRAMES
            may_block = self._may_block and not isinstance(message, (Tick, ServerFrame, Verdict))
            key = keys.publication_key(self._robot, topic, message, user=self._user)
            publisher = _TopicPublisher(
                declare_publisher(
                    self._session, key, priority=priority, may_block=may_block, own=not self._is_local(topic)
                )
            )
            self._topic_publishers[topic] = publisher
        return publisher

    def _connection_publisher(self, key: str, message: SentMessage, now_ns: int) -> zenoh.Publisher:
        publisher, _ = self._connection_publishers.pop(key, (None, 0))
        if publisher is None:
            self._release_idle(now_ns)
            priority = SendPriority.STOP if self._urgent else priority_of(message)
            publisher = declare_publisher(self._session, key, priority=priority, may_block=self._may_block)
        # reinserted at the end, so that the publishers are in order of last use
        self._connection_publishers[key] = (publisher, now_ns)
        return publisher

    def _release_idle(self, now_ns: int) -> None:
        """Release publishers that are idle, and those beyond the limit."""
        while self._connection_publishers:
            key, (publisher, used_ns) = next(iter(self._connection_publishers.items()))
            if now_ns - used_ns <= IDLE_NS and len(self._connection_publishers) < MAX_CONNECTION_PUBLISHERS:
                return
            del self._connection_publishers[key]
            publisher.undeclare()  # type: ignore[no-untyped-call]


class _TopicPublisher:
    """A publisher of a topic, and True if anybody listens. Mutable: a network thread notes who does."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self.publisher = publisher
        self.is_heard = True
        handler = zenoh.handlers.Callback(self._note, indirect=False)
        self._listener = publisher.declare_matching_listener(handler)
        self.is_heard = publisher.matching_status.matching  # type: ignore[attr-defined]

    def _note(self, status: zenoh.MatchingStatus) -> None:
        self.is_heard = status.matching


class SendPriority(Enum):
    """The priority of a message on a link: emergency stops overtake frames, frames overtake calls."""

    STOP = zenoh.Priority.REAL_TIME
    FRAMES = zenoh.Priority.INTERACTIVE_HIGH
    CALLS = zenoh.Priority.DATA


def priority_of(message: SentMessage) -> SendPriority:
    """Return the priority of a message between a connection and a server."""
    return SendPriority.STOP if isinstance(message, Call) and message.right == "stop" else SendPriority.CALLS


def declare_publisher(
    session: zenoh.Session,
    key: str,
    *,
    priority: SendPriority = SendPriority.CALLS,
    may_block: bool = True,
    own: bool = True,
) -> zenoh.Publisher:
    """Declare a publisher that waits for room if `may_block`, and drops messages otherwise.

    With `own` false, it sends to other processes only.
    """
    block, drop = zenoh.CongestionControl.BLOCK, zenoh.CongestionControl.DROP
    return session.declare_publisher(
        key,
        congestion_control=block if may_block else drop,
        reliability=zenoh.Reliability.RELIABLE,
        priority=priority.value,
        express=priority is SendPriority.STOP,
        allowed_destination=zenoh.Locality.ANY if own else zenoh.Locality.REMOTE,
    )


def _is_large(message: Batched) -> bool:
    """Return True if a message is too large for a batch."""
    if isinstance(message, Ready):
        return message.progress is not None
    return isinstance(message, Checkpoint) and len(message.memory) > MAX_BATCHED_BYTES


def _too_large(reply: Reply, why: str) -> Reply:
    problem = Problem(code="size", message=f"the result is too large: {why}")
    return Reply(connection=reply.connection, number=reply.number, problem=problem)
