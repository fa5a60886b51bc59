"""How messages leave a process: one declared publisher a key, so that a message without a listener costs next
to nothing.

What goes to all readers each frame is dropped for one who leaves no room for it, because a reader that is
frozen must not hold up the server, and whoever missed a frame asks for it again. All else waits for room,
and overtakes nothing; the messages of frames overtake calls and their answers, which may be whole images.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import Enum

import zenoh

from colony.runtime.protocol import codec
from colony.runtime.protocol.messages import (
    MOST_IN_BATCH,
    Alive,
    Batch,
    Call,
    Checkpoint,
    Notice,
    Problem,
    Ready,
    Reply,
    Request,
    Send,
    Sent,
    ServerFrame,
    Tick,
    Verdict,
)
from colony.runtime.transport.live import keys

IDLE_NS = 10_000_000_000
"""Nanoseconds without a message after which the publisher for a connection is given back."""

SMALL_BYTES = 1024
"""Bytes of a small message: of the memory of a client that goes together with that of others, and of a reply
that a thread of the network sends."""

PASSING_MOST = 256
"""Publishers for connections at a time."""

Report = Callable[[str], None]
"""Told of something that went wrong and is survived, in a sentence."""


class Outbox:
    """Mutable: the publishers, and when those for connections were used last."""

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
        """Unless `patient`, replies are dropped instead of waiting for room: callers ask again. If `urgent`,
        they overtake all else besides."""
        self._session = session
        self._robot = robot
        self._report = report
        self._user = user
        self._patient = patient and not urgent
        self._urgent = urgent
        self._lasting: dict[str, zenoh.Publisher] = {}
        self._passing: dict[str, tuple[zenoh.Publisher, int]] = {}

    def send_all(self, sends: Iterable[Send], now_ns: int) -> None:
        """Send messages; what clients say to one server goes in one piece."""
        batches: dict[str, list[Request | Ready | Checkpoint]] = {}
        for topic, message in sends:
            if isinstance(message, (Request, Ready)) or (
                isinstance(message, Checkpoint) and len(message.memory) <= SMALL_BYTES
            ):
                batches.setdefault(topic, []).append(message)
            else:
                self.send(topic, message, now_ns)
        for topic, messages in batches.items():
            if len(messages) == 1:
                self.send(topic, messages[0], now_ns)
                continue
            for i in range(0, len(messages), MOST_IN_BATCH):
                self.send(topic, Batch(messages=tuple(messages[i : i + MOST_IN_BATCH])), now_ns)

    def send(self, topic: str, message: Sent | Batch, now_ns: int) -> None:
        """Send a message; one that is too large is reported, and a reply then says so."""
        try:
            data = codec.encode(message)
        except ValueError as problem:
            if isinstance(message, Batch) and len(message.messages) > 1:
                half = len(message.messages) // 2
                for part in (message.messages[:half], message.messages[half:]):
                    self.send(topic, Batch(messages=part), now_ns)
                return
            self._report(f"to {topic}: {problem}")
            if not isinstance(message, Reply):
                return
            data = codec.encode(_too_large(message, str(problem)))
        try:
            self._put(topic, message, data, now_ns)
        except zenoh.ZError as problem:  # a name that somebody gave cannot be part of a key
            self._report(f"to {topic}: {problem}")

    def _put(self, topic: str, message: Sent | Batch, data: bytes, now_ns: int) -> None:
        if isinstance(message, (Call, Alive, Reply, Notice, Checkpoint)):
            self._pass(keys.sending(self._robot, topic, message, user=self._user), data, message, now_ns)
            return
        publisher = self._lasting.get(topic)
        if publisher is None:
            patient = not isinstance(message, (Tick, ServerFrame, Verdict))
            key = keys.sending(self._robot, topic, message, user=self._user)
            publisher = publish(self._session, key, haste=Haste.FRAMES, patient=patient)
            self._lasting[topic] = publisher
        publisher.put(data)

    def _pass(self, key: str, data: bytes, message: Sent, now_ns: int) -> None:
        publisher, _ = self._passing.pop(key, (None, 0))
        if publisher is None:
            self._tidy(now_ns)
            haste = Haste.STOP if self._urgent else haste_of(message)
            publisher = publish(self._session, key, haste=haste, patient=self._patient)
        self._passing[key] = (publisher, now_ns)  # the last one, so that the first was idle for longest
        publisher.put(data)

    def _tidy(self, now_ns: int) -> None:
        """Give back what was not used for long, and what is too much."""
        while self._passing:
            key, (publisher, used_ns) = next(iter(self._passing.items()))
            if now_ns - used_ns <= IDLE_NS and len(self._passing) < PASSING_MOST:
                return
            del self._passing[key]
            publisher.undeclare()  # type: ignore[no-untyped-call]


class Haste(Enum):
    """What overtakes what on a link: emergency stops all else, frames calls."""

    STOP = zenoh.Priority.REAL_TIME
    FRAMES = zenoh.Priority.INTERACTIVE_HIGH
    CALLS = zenoh.Priority.DATA


def haste_of(message: Sent) -> Haste:
    """That of what passes between a connection and a server."""
    return Haste.STOP if isinstance(message, Call) and message.right == "stop" else Haste.CALLS


def publish(
    session: zenoh.Session, key: str, *, haste: Haste = Haste.CALLS, patient: bool = True
) -> zenoh.Publisher:
    """A publisher that, if `patient`, waits for room rather than drop."""
    block, drop = zenoh.CongestionControl.BLOCK, zenoh.CongestionControl.DROP
    return session.declare_publisher(
        key,
        congestion_control=block if patient else drop,
        reliability=zenoh.Reliability.RELIABLE,
        priority=haste.value,
        express=haste is Haste.STOP,
    )


def _too_large(reply: Reply, why: str) -> Reply:
    problem = Problem(code="size", message=f"the result is too large: {why}")
    return Reply(connection=reply.connection, number=reply.number, problem=problem)
