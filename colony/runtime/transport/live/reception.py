"""Reception of messages in the network threads: count each, check its size, and queue it for handling.

Handlers run in zenoh's threads, which must not block: a blocked thread stops reception for the whole process.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, suppress
from queue import SimpleQueue
from threading import Thread
from typing import NamedTuple

import zenoh

from colony.runtime.protocol import codec
from colony.runtime.protocol.calls import EMERGENCY_STOP
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES, MessageFormatError
from colony.runtime.protocol.messages import Alive, Call, Malformed
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.inbox import Inbox, size_violation
from colony.runtime.transport.live.keys import CallKey
from colony.runtime.transport.live.limits import RateLimits
from colony.runtime.transport.live.network import ZenohSession, local_user

# --- stop lane -----------------------------------------------------------------------------------------
#
# A separate queue and thread for emergency stops.
#
# The receiving thread puts messages sent with the `stop` right into the queue, undecoded. The lane's thread
# decodes them and hands over emergency stops immediately. Other messages with this right, such as those
# that open a connection, join all other calls.


MAX_QUEUED = 1024
"""Maximum number of queued messages: the bursts (`rate_limits.STOP_RATE`) of ten users at once."""

OtherHandler = Callable[[str, str, Call | Alive | Malformed, int], None]
"""A handler of messages other than emergency stops: topic, connection, content, size in bytes."""


class _Received(NamedTuple):
    topic: str
    key: CallKey
    data: bytes
    duplicate: bool


class StopLane:
    """A queue with its own thread. Mutable.

    Args:
        on_stop: handler of an emergency stop on a topic; called in the lane's thread.
        on_other: handler of any other message; called in the lane's thread.
    """

    def __init__(self, on_stop: Callable[[str, Call], None], on_other: OtherHandler) -> None:
        self._on_stop = on_stop
        self._on_other = on_other
        self._queue: SimpleQueue[_Received | None] = SimpleQueue()
        self._thread = Thread(target=self._run, name="emergency stops", daemon=True)
        self._thread.start()

    def put(self, topic: str, key: CallKey, data: bytes, *, duplicate: bool = False) -> None:
        """Queue a message from the network without blocking; drop it if the queue is full.

        `duplicate` marks the second copy of a message that arrives over two sessions: it is handled only if
        it is an emergency stop, whose repetition is recognized.
        """
        if self._queue.qsize() < MAX_QUEUED:
            self._queue.put(_Received(topic, key, data, duplicate))

    def close(self) -> None:
        """Handle the queued messages, and end the thread."""
        self._queue.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (received := self._queue.get()) is not None:
            message = _read(received)
            if isinstance(message, Call) and message.method == EMERGENCY_STOP:
                self._on_stop(received.topic, message)
            elif not received.duplicate:
                self._on_other(received.topic, received.key.connection, message, len(received.data))


def _read(received: _Received) -> Call | Alive | Malformed:
    try:
        return keys.check_call(codec.decode(received.data), received.key)
    except MessageFormatError as problem:
        return Malformed(topic=received.topic, connection=received.key.connection, reason=str(problem))


# --- reception -----------------------------------------------------------------------------------------


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
