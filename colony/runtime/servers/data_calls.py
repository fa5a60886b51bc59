"""Handling of the calls of DServer, which the functions of `library/data.py` make (thesis section 4.6.1).

Variables, semaphores, watches and answers put their changes into one journal, which the server commits before
any effect leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import msgspec

from colony.ir.servers import DSERVER
from colony.runtime.library.data import (
    Publish,
    Watch,
)
from colony.runtime.protocol.calls import CallDispatcher, CallId, Handler, Later, Method, RefusedError, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.messages import Effect, Message, Wake, WakeAt
from colony.runtime.protocol.wakes import WakeSchedule
from colony.runtime.servers.call_answers import CallAnswers
from colony.runtime.servers.data_methods import MAX_NAMES_BYTES, DataMethods, check_count
from colony.runtime.servers.frame_content import FrameSubscriptions
from colony.runtime.servers.names import validate_name
from colony.runtime.servers.notices import SLICE_INTERVAL_NS, NoticeQueue
from colony.runtime.servers.outside_control import Answer
from colony.runtime.servers.semaphores import Semaphores
from colony.runtime.servers.variables import (
    Variables,
)
from colony.runtime.servers.watching import Watches

RECONNECT_GRACE_NS = 2_000_000_000
"""Nanoseconds after a restart for which the holds of a connection wait for it to reconnect.

If it were shorter, a client about to reconnect could find that another client holds its semaphore as well.
"""


class DataCalls:
    """Handles the calls of DServer. Mutable.

    Args:
        variables: the variables, loaded.
        semaphores: the semaphores, loaded.
        answers: the answers to calls, loaded.
        watches: the watches of connections, loaded.
        frame_subscriptions: the variables that connections subscribed to in frames, loaded.
        other_methods: further methods of the server.
        on_lost: called for each connection that has ended; returns effects.
        stop: carries out an emergency stop, given the connection and the time.
        other_limit_messages: returns messages about limits that the server has reached.
        storage_problem: returns the reason why changes cannot be stored, None while they can.
    """

    def __init__(
        self,
        variables: Variables,
        semaphores: Semaphores,
        answers: CallAnswers,
        watches: Watches,
        frame_subscriptions: FrameSubscriptions,
        *,
        other_methods: Iterable[Method] = (),
        on_lost: Callable[[Caller, int], Iterable[Effect]] = lambda caller, now_ns: (),
        stop: Callable[[str, int], None] | None = None,
        other_limit_messages: Callable[[], Iterable[str]] = lambda: (),
        storage_problem: Callable[[], str | None] = lambda: None,
    ) -> None:
        self._storage_problem = storage_problem
        self._variables = variables
        self._semaphores = semaphores
        self._answers = answers
        self._watches = watches
        self._frame_subscriptions = frame_subscriptions
        self._notices = NoticeQueue(variables, watches, self._notify)
        self._data = DataMethods(variables, semaphores, self._notices.mark_changed)
        self._next_slice_ns: int | None = None
        self._calls = CallDispatcher(
            DSERVER.name,
            (*self._methods(), *other_methods),
            admit=self._admit,
            on_lost=self._end,
            stop=stop,
            other_limit_messages=other_limit_messages,
        )
        self._on_lost = on_lost
        self._callers: dict[str, Caller] = {}
        self._opened: list[str] = []
        self._wakes = WakeSchedule()
        self._reconnect_by_ns: int | None = None
        self.listens = self._calls.listens

    def start(self, now_ns: int) -> Iterator[Effect]:
        """Give the connections of before a restart time to reconnect; none is open yet."""
        self._watches.start(now_ns)
        if self._semaphores.holders_except(()):
            self._reconnect_by_ns = now_ns + RECONNECT_GRACE_NS
            yield WakeAt(self._reconnect_by_ns)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Handle calls, signs of life, malformed calls, and wakes."""
        if isinstance(message, Wake):
            self._wake(now_ns)
        yield from self._calls.handle(message, now_ns)
        if self._opened:
            self._restore_watches()
        yield from self._settle(now_ns)
        if self._notices.pending:
            yield from self._send_notices(now_ns)

    def settle(self, answers: Iterable[Answer]) -> Iterator[Effect]:
        """Answer calls of other methods that waited."""
        yield from self._calls.settle(answers)

    def changed(self, names: Iterable[str], now_ns: int) -> Iterator[Effect]:
        """Send notices about variables that actuators have set."""
        for name in names:
            self._notices.mark_changed(name)
        yield from self._send_notices(now_ns)

    def _methods(self) -> tuple[Method, ...]:
        return (
            *(
                m if m.right == "read" else m._replace(handler=self._once(m.handler))
                for m in self._data.methods
            ),
            method("publish", Publish, self._publish, right="read", lasting=True, max_bytes=MAX_NAMES_BYTES),
            method("watch", Watch, self._watch, right="read", lasting=True, max_bytes=MAX_NAMES_BYTES),
            method("unwatch", Watch, self._unwatch, right="read", lasting=True, max_bytes=MAX_NAMES_BYTES),
        )

    def _once(self, handler: Handler) -> Handler:
        """Return a handler that answers a repeated call with the recorded answer."""

        def handle(call_id: CallId, arguments: Any, now_ns: int) -> object:
            connection, number = call_id.caller.connection, call_id.number
            recorded = self._answers.find(connection, number)
            if recorded is not None:
                return msgspec.Raw(recorded)
            try:
                self._check_space()
                result = handler(call_id, arguments, now_ns)
            except RefusedError:
                self._answers.clear_pending(connection, number)
                raise
            if isinstance(result, Later):
                self._answers.mark_pending(connection, number)
            else:
                self._answers.record(connection, number, _encode(result))
            return result

        return handle

    def _check_space(self) -> None:
        """Check that the changes of a call can be stored.

        Raises:
            RefusedError: "full".
        """
        if (reason := self._storage_problem()) is not None:
            raise RefusedError("full", f"DServer keeps nothing new: {reason}")

    # --- variables -----------------------------------------------------------------------------------

    def _publish(self, call_id: CallId, arguments: Publish, now_ns: int) -> None:
        check_count(len(arguments.names))
        names = dict.fromkeys(validate_name(name) for name in arguments.names)
        self._variables.check_frame_space(names)
        self._variables.show(self._frame_subscriptions.subscribe(call_id.caller.connection, names))

    # --- changes -------------------------------------------------------------------------------------

    def _watch(self, call_id: CallId, arguments: Watch, now_ns: int) -> None:
        self._check_space()
        check_count(len(arguments.names) + len(arguments.prefixes))
        for text in (*arguments.names, *arguments.prefixes):
            validate_name(text or "-")  # a prefix may be empty
        connection = call_id.caller.connection
        self._watches.add(connection, arguments.names, arguments.prefixes)
        self._notices.queue_current_values(connection, arguments.names, arguments.prefixes)

    def _unwatch(self, call_id: CallId, arguments: Watch, now_ns: int) -> None:
        check_count(len(arguments.names) + len(arguments.prefixes))
        if arguments.names or arguments.prefixes:
            self._watches.remove(call_id.caller.connection, arguments.names, arguments.prefixes)
        else:
            self._watches.forget(call_id.caller.connection)

    def _notify(self, connection: str, name: str, body: msgspec.Raw) -> Iterator[Effect]:
        caller = self._callers.get(connection)
        if caller is not None:
            yield from self._calls.notify(caller, name, body)

    def _send_notices(self, now_ns: int) -> Iterator[Effect]:
        """Send one slice of notices, and schedule a wake if more are pending."""
        yield from self._notices.slice()
        if not self._notices.pending:
            self._next_slice_ns = None
        elif self._next_slice_ns is None or now_ns >= self._next_slice_ns:
            self._next_slice_ns = now_ns + SLICE_INTERVAL_NS
            yield WakeAt(self._next_slice_ns)

    # --- connections and time ------------------------------------------------------------------------

    def _admit(self, caller: Caller) -> None:
        self._callers[caller.connection] = caller
        self._opened.append(caller.connection)

    def _restore_watches(self) -> None:
        """Restore the watches of reopened connections, and queue notices of the current values."""
        opened, self._opened = self._opened, []
        for connection in opened:
            self._watches.on_reopened(connection)
            self._notices.queue_current_values(connection, *self._watches.watched_by(connection))

    def _end(self, caller: Caller, now_ns: int) -> Iterable[Effect]:
        connection = caller.connection
        self._callers.pop(connection, None)
        self._watches.on_lost(connection, now_ns)
        self._notices.on_lost(connection)
        self._variables.hide(self._frame_subscriptions.on_lost(connection))
        self._release_semaphores(connection)
        return self._on_lost(caller, now_ns)

    def _release_semaphores(self, connection: str) -> None:
        """Remove a connection from all queues, and release the semaphores that it holds."""
        for number in self._data.drop(connection):
            self._answers.forget(connection, number)

    def _wake(self, now_ns: int) -> None:
        self._watches.expire(now_ns)
        if self._reconnect_by_ns is not None and now_ns >= self._reconnect_by_ns:
            self._reconnect_by_ns = None
            for connection in self._semaphores.holders_except(self._callers):
                self._release_semaphores(connection)
        self._data.expire(now_ns)

    def _settle(self, now_ns: int) -> Iterator[Effect]:
        """Answer the calls that have ended, and schedule a wake for those that still wait."""
        answers, self._data.answers = self._data.answers, []
        for call_id, result in answers:
            if isinstance(result, RefusedError):
                self._answers.clear_pending(call_id.caller.connection, call_id.number)
            else:
                self._answers.record(call_id.caller.connection, call_id.number, _NIL)
        yield from self._calls.settle(answers)
        yield from self._wakes.request(self._data.wake_at, now_ns)


_encode = msgspec.msgpack.Encoder().encode
_NIL = _encode(None)
