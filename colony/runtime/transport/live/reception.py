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
from colony.runtime.transport.live.deferred import DeferredFrames
from colony.runtime.transport.live.inbox import Inbox
from colony.runtime.transport.live.message_queue import size_violation
from colony.runtime.transport.live.network import ZenohSession, local_user
from colony.runtime.transport.live.rate_limits import RateLimits
from colony.runtime.transport.live.stop_lane import StopLane

Handler = Callable[[zenoh.Sample], None]

DirectHandler = Callable[[str, bytes | Call], bool]
"""A function that handles a message in the receiving thread.

It returns False if the message must go to the inbox.
"""


class Reception:
    """The subscriptions of a host, and their handlers.

    Args:
        network: session from which messages come.
        inbox: queue of the host's own thread.
        deferred: ring buffers of frames that are handled together with other messages.
        direct_handler: handler that is tried before the inbox, except for deferred messages; None in hosts
            that are not direct.
        on_stop: handler of emergency stops, called in its own thread, one stop at a time.
    """

    def __init__(
        self,
        network: ZenohSession,
        inbox: Inbox,
        deferred: DeferredFrames,
        *,
        direct_handler: DirectHandler | None,
        on_stop: Callable[[str, Call], None],
    ) -> None:
        self._network = network
        self._inbox = inbox
        self._deferred = deferred
        self._direct_handler = direct_handler
        self._on_stop = on_stop
        self._stop_lane: StopLane | None = None
        self._rate_limits = RateLimits(local_user())

    def listen(self, topic: str, declared: ExitStack, *, defers: bool) -> None:
        """Receive messages on a topic until `declared` is closed; with `defers`, they wake no thread."""
        robot = self._network.robot
        if keys.carries_calls(topic):
            for right in keys.RIGHTS:
                if right != "stop":
                    key = keys.call_subscription_key(robot, topic, right)
                    self._subscribe(key, self._call_handler(topic), declared)
            self._listen_to_stops(topic, declared)
        elif defers and keys.carries_frames(topic):
            self._deferred.listen(topic, declared)
        else:
            self._subscribe(keys.subscription_key(robot, topic), self._frame_handler(topic, defers), declared)

    def _listen_to_stops(self, topic: str, declared: ExitStack) -> None:
        """Put messages sent with the `stop` right into the lane, over both sessions if there are two.

        All topics share one lane: `on_stop` sends with an outbox, which is for one thread at a time.
        """
        lane = self._stop_lane
        if lane is None:
            lane = self._stop_lane = StopLane(self._on_stop, self._inbox.add_call)
            declared.callback(lane.close)
        key = keys.call_subscription_key(self._network.robot, topic, "stop")
        self._subscribe(key, _stop_handler(topic, lane, self._rate_limits, duplicate=False), declared)
        if self._network.stops is not None:
            handler = _stop_handler(topic, lane, RateLimits(local_user()), duplicate=True)
            self._subscribe(key, handler, declared, self._network.stops)

    def _subscribe(
        self, key: str, handler: Handler, declared: ExitStack, session: zenoh.Session | None = None
    ) -> None:
        session = self._network.session if session is None else session
        callback = zenoh.handlers.Callback(handler, indirect=False)
        declared.callback(session.declare_subscriber(key, callback).undeclare)

    def _frame_handler(self, topic: str, defers: bool) -> Handler:
        """Return the handler of a topic that does not carry calls."""
        add, limits = self._inbox.add_frame_message, self._rate_limits
        kind, direct = keys.user_message_kind(topic), None if defers else self._direct_handler

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
            elif direct is None or not direct(topic, data):
                add(topic, data, rouse=not defers)

        return take

    def _call_handler(self, topic: str) -> Handler:
        inbox, limits, direct = self._inbox, self._rate_limits, self._direct_handler

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
                if direct is None or not isinstance(message, Call) or not direct(topic, message):
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
