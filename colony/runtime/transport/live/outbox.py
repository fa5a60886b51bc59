"""A process's outgoing messages, with one declared publisher per key.

A message without a listener therefore costs almost nothing.

Ticks, server frames and verdicts go to all readers, and are dropped for a reader whose link has no room,
because a frozen reader must not hold up the server; a reader fetches the frames that it missed. Other
messages wait for room if the outbox is patient. Otherwise they are dropped too, and their senders repeat
them: clients with the next frame, connections with the same call.

Messages of frames overtake checkpoints, calls and their replies, which may be whole images.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from enum import Enum

import zenoh

from colony.runtime.protocol import codec
from colony.runtime.protocol.messages import (
    MOST_IN_BATCH,
    Alive,
    Batch,
    Batched,
    Call,
    Checkpoint,
    Notice,
    Problem,
    Reply,
    Send,
    Sent,
    ServerFrame,
    Tick,
    Verdict,
    Wire,
)
from colony.runtime.transport.live import keys

IDLE_NS = 10_000_000_000
"""Nanoseconds without a message after which a connection's publisher is released."""

SMALL_BYTES = 1024
"""Size in bytes of the largest checkpoint that travels in a batch."""

PASSING_MOST = 256
"""Publishers for connections that exist at the same time."""

Report = Callable[[str], None]
"""A function that takes a sentence on each survived problem."""


class Outbox:
    """The publishers of a process. Mutable: the publishers, and when those of connections were last used."""

    def __init__(
        self,
        session: zenoh.Session,
        robot: str,
        report: Report,
        *,
        user: str,
        patient: bool = True,
        urgent: bool = False,
    ) -> None:
        """Create an outbox for one thread at a time.

        Args:
            session: the session to send with.
            robot: the robot whose processes receive the messages.
            report: takes a sentence on each message that cannot be sent.
            user: the user as whom clients send.
            patient: True to make messages that do not go to all readers wait for room rather than be dropped.
            urgent: True to let replies overtake all other messages; then no message waits for room.
        """
        self._session = session
        self._robot = robot
        self._report = report
        self._user = user
        self._patient = patient and not urgent
        self._urgent = urgent
        self._lasting: dict[str, zenoh.Publisher] = {}
        self._passing: dict[str, tuple[zenoh.Publisher, int]] = {}

    def send_all(self, sends: Iterable[Send], now_ns: int) -> None:
        """Send messages: first the single ones, then those that clients send to one server, as batches."""
        batches: dict[str, list[Batched]] = {}
        for topic, message in sends:
            if isinstance(message, Batched) and not _is_large(message):
                batches.setdefault(topic, []).append(message)
            else:
                self.send(topic, message, now_ns)
        for topic, messages in batches.items():
            for i in range(0, len(messages), MOST_IN_BATCH):
                self._send_together(topic, messages[i : i + MOST_IN_BATCH], now_ns)

    def send(self, topic: str, message: Sent, now_ns: int) -> None:
        """Send a message; report one that is too large, and replace a reply by one that says so."""
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

    def _put(self, topic: str, message: Wire, data: bytes, now_ns: int) -> None:
        try:
            self._publisher(topic, message, now_ns).put(data)
        except zenoh.ZError as problem:  # a name given by a user cannot be part of a key
            self._report(f"to {topic}: {problem}")

    def _publisher(self, topic: str, message: Wire, now_ns: int) -> zenoh.Publisher:
        key = keys.sending(self._robot, topic, message, user=self._user)
        # the messages of a batch are of one kind
        first = message.messages[0] if isinstance(message, Batch) else message
        if isinstance(first, (Call, Alive, Reply, Notice, Checkpoint)):
            return self._passing_publisher(key, first, now_ns)
        publisher = self._lasting.get(topic)
        if publisher is None:
            patient = self._patient and not isinstance(first, (Tick, ServerFrame, Verdict))
            publisher = publish(self._session, key, haste=Haste.FRAMES, patient=patient)
            self._lasting[topic] = publisher
        return publisher

    def _passing_publisher(self, key: str, message: Sent, now_ns: int) -> zenoh.Publisher:
        publisher, _ = self._passing.pop(key, (None, 0))
        if publisher is None:
            self._tidy(now_ns)
            haste = Haste.STOP if self._urgent else haste_of(message)
            publisher = publish(self._session, key, haste=haste, patient=self._patient)
        self._passing[key] = (publisher, now_ns)  # reinserted last, so that the first was idle for longest
        return publisher

    def _tidy(self, now_ns: int) -> None:
        """Release publishers that are idle, and those beyond the limit."""
        while self._passing:
            key, (publisher, used_ns) = next(iter(self._passing.items()))
            if now_ns - used_ns <= IDLE_NS and len(self._passing) < PASSING_MOST:
                return
            del self._passing[key]
            publisher.undeclare()  # type: ignore[no-untyped-call]


class Haste(Enum):
    """The priority of a message on a link: emergency stops overtake frames, frames overtake calls."""

    STOP = zenoh.Priority.REAL_TIME
    FRAMES = zenoh.Priority.INTERACTIVE_HIGH
    CALLS = zenoh.Priority.DATA


def haste_of(message: Sent) -> Haste:
    """Return the priority of a message between a connection and a server."""
    return Haste.STOP if isinstance(message, Call) and message.right == "stop" else Haste.CALLS


def publish(
    session: zenoh.Session, key: str, *, haste: Haste = Haste.CALLS, patient: bool = True
) -> zenoh.Publisher:
    """Declare a publisher that waits for room if `patient`, and drops messages otherwise."""
    block, drop = zenoh.CongestionControl.BLOCK, zenoh.CongestionControl.DROP
    return session.declare_publisher(
        key,
        congestion_control=block if patient else drop,
        reliability=zenoh.Reliability.RELIABLE,
        priority=haste.value,
        express=haste is Haste.STOP,
    )


def _is_large(message: Batched) -> bool:
    """Return True if a message is too large for a batch: batches without it stay small."""
    return isinstance(message, Checkpoint) and len(message.memory) > SMALL_BYTES


def _too_large(reply: Reply, why: str) -> Reply:
    problem = Problem(code="size", message=f"the result is too large: {why}")
    return Reply(connection=reply.connection, number=reply.number, problem=problem)
