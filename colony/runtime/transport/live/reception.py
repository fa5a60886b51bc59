"""Reception of messages in the network threads: count each, check its size, and queue it for handling.

Handlers run in zenoh's threads, which must not block: a blocked thread stops reception for the whole process.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, suppress

import zenoh

from colony.runtime.protocol import codec
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES, MessageFormatError
from colony.runtime.protocol.messages import Call, Malformed
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.inbox import Inbox
from colony.runtime.transport.live.message_queue import size_violation
from colony.runtime.transport.live.network import ZenohSession, local_user
from colony.runtime.transport.live.rate_limits import RateLimits
from colony.runtime.transport.live.stop_lane import StopLane

Handler = Callable[[zenoh.Sample], None]

StopHandler = Callable[[str, Call], None]
"""A handler of an emergency stop on a topic."""


class Reception:
    """The subscriptions of a host, and their handlers.

    Args:
        network: session from which messages come.
        inbox: queue of the host's own thread.
        on_stop: returns a handler of emergency stops, to be called in one thread, one stop at a time.
    """

    def __init__(self, network: ZenohSession, inbox: Inbox, *, on_stop: Callable[[], StopHandler]) -> None:
        self._network = network
        self._inbox = inbox
        self._on_stop = on_stop
        self._rate_limits = RateLimits(local_user())
        self._topics: set[str] = set()

    def listen(self, topic: str, declared: ExitStack) -> bool:
        """Receive messages of other processes on a topic until `declared` is closed.

        Returns False if they are received already.
        """
        if topic in self._topics:
            return False
        self._topics.add(topic)
        robot = self._network.robot
        if keys.carries_calls(topic):
            for right in keys.RIGHTS:
                if right != "stop":
                    key = keys.call_subscription_key(robot, topic, right)
                    self._subscribe(key, self._call_handler(topic), declared)
            self._listen_to_stops(topic, declared)
        else:
            handler = self._frame_handler(topic)
            self._subscribe(keys.subscription_key(robot, topic), handler, declared, own=False)
        return True

    def _listen_to_stops(self, topic: str, declared: ExitStack) -> None:
        """Put messages sent with the `stop` right into a lane, over both sessions if there are two.

        Each topic has its own: the stop of one server does not wait until another has stored its own.
        """
        lane = StopLane(self._on_stop(), self._inbox.add_call)
        declared.callback(lane.close)
        key = keys.call_subscription_key(self._network.robot, topic, "stop")
        self._subscribe(key, _stop_handler(topic, lane, self._rate_limits, duplicate=False), declared)
        if self._network.stops is not None:
            handler = _stop_handler(topic, lane, RateLimits(local_user()), duplicate=True)
            self._subscribe(key, handler, declared, self._network.stops)

    def _subscribe(
        self,
        key: str,
        handler: Handler,
        declared: ExitStack,
        session: zenoh.Session | None = None,
        *,
        own: bool = True,
    ) -> None:
        """Subscribe to a key; with `own` false, not to what this process publishes."""
        session = self._network.session if session is None else session
        callback = zenoh.handlers.Callback(handler, indirect=False)
        origin = zenoh.Locality.ANY if own else zenoh.Locality.REMOTE
        declared.callback(session.declare_subscriber(key, callback, allowed_origin=origin).undeclare)

    def _frame_handler(self, topic: str) -> Handler:
        """Return the handler of a topic that does not carry calls."""
        add, limits = self._inbox.add_frame_message, self._rate_limits
        kind = keys.user_message_kind(topic)

        def take(sample: zenoh.Sample) -> None:
            payload = sample.payload
            size = len(payload)
            data = payload.to_bytes() if size <= MAX_MESSAGE_BYTES else b""
            if kind is not None:
                user = str(sample.key_expr).rpartition("/")[2]
                if not limits.admit_frame(kind, user, size, codec.message_count(data)):
                    return  # no reply: a reader fetches a missed frame again
            if size > MAX_MESSAGE_BYTES:
                add(topic, size_violation(topic, None, size))
            else:
                add(topic, data)

        return take

    def _call_handler(self, topic: str) -> Handler:
        inbox, limits = self._inbox, self._rate_limits

        def take(sample: zenoh.Sample) -> None:
            payload = sample.payload
            key = keys.call_key(str(sample.key_expr))
            size = len(payload)
            if key is None:
                return  # without a connection in the key, there is nobody to reply to
            if inbox.is_full_for(key.connection) or not limits.admit_call(key.connection, size):
                if limits.admit_refusal(key.connection) and size <= MAX_MESSAGE_BYTES:
                    self._refuse(topic, key, payload.to_bytes())
                return
            if size > MAX_MESSAGE_BYTES:
                inbox.add_call(topic, key.connection, size_violation(topic, key.connection, size), 0)
                return
            try:
                message = keys.check_call(codec.decode(payload.to_bytes()), key)
            except MessageFormatError as problem:
                malformed = Malformed(topic=topic, connection=key.connection, reason=str(problem))
                inbox.add_call(topic, key.connection, malformed, 0)
            else:
                inbox.add_call(topic, key.connection, message, size)

        return take

    def _refuse(self, topic: str, key: keys.CallKey, data: bytes) -> None:
        """Refuse a call with the code "flood"; malformed bytes get no reply."""
        with suppress(MessageFormatError):
            message = keys.check_call(codec.decode(data), key)
            number = message.number if isinstance(message, Call) else 0
            self._inbox.refuse(topic, key.connection, number)


def _stop_handler(topic: str, lane: StopLane, limits: RateLimits, *, duplicate: bool) -> Handler:
    """Return the handler of one session's messages sent with the `stop` right.

    With `duplicate`, another session also receives these messages, so only emergency stops are handled.
    """

    def take(sample: zenoh.Sample) -> None:
        payload = sample.payload
        key = keys.call_key(str(sample.key_expr))
        if (
            key is not None
            and len(payload) <= MAX_MESSAGE_BYTES
            and limits.admit_stop(key.connection, len(payload))
        ):
            lane.put(topic, key, payload.to_bytes(), duplicate=duplicate)

    return take
