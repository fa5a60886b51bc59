"""Frames that a host handles together with its other messages.

Waking a thread for a message costs more than handling it. A node that does not need some frames until
it has something else to handle (`messages.DeferringNode`) avoids that cost: zenoh keeps these frames in one
ring per topic, and the host takes them whenever it handles a message or a node's wake is due.

Only frames are kept this way, because a reader can fetch a frame that its ring dropped. Other deferrable
topics go through the inbox without waking the host: users' messages must be counted on arrival, and
verdicts cannot be fetched again.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import zenoh

from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.message_queue import QueuedMessage, size_violation

MAX_DEFERRED_FRAMES = 128
"""Deferred frames kept per topic. A full ring drops its oldest frame; a reader fetches it again."""

DEFERRED_BATCH = 8
"""Maximum number of frames taken from one topic before other messages are handled."""

_Subscriber = zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]


class DeferredFrames:
    """The rings of a host. Stateful: holds the waiting frames."""

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        self._session = session
        self._robot = robot
        self._rings: list[tuple[str, _Subscriber]] = []

    def listen(self, topic: str, declared: ExitStack) -> None:
        """Keep the frames of a topic from now on, until `declared` is closed."""
        handler: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(MAX_DEFERRED_FRAMES)
        subscriber = self._session.declare_subscriber(keys.subscription_key(self._robot, topic), handler)
        declared.callback(subscriber.undeclare)
        self._rings.append((topic, subscriber))

    def take(self) -> Iterator[QueuedMessage]:
        """Yield the waiting frames, at most `DEFERRED_BATCH` of each topic."""
        for topic, subscriber in self._rings:
            for _ in range(DEFERRED_BATCH):
                sample = subscriber.try_recv()
                if sample is None:
                    break
                size = len(sample.payload)
                message = (
                    sample.payload.to_bytes()
                    if size <= MAX_MESSAGE_BYTES
                    else size_violation(topic, None, size)
                )
                yield QueuedMessage(topic, message)
