"""Call handling of a server: connections with priorities and leases, typed methods, replies.

The calls are those of thesis section 4.5.3. A server lists its methods and gives its messages to a
`CallDispatcher`:

    METHODS = (method("level", Level, read_level, right="read"), ...)
    dispatcher = CallDispatcher("Battery", METHODS)
    effects = dispatcher.handle(message, now_ns)

A connection begins with the call `open` and ends with the call `close`, or when its lease expires. A call
that changes something is executed once, however often it arrives: a repeated call gets the same answer. A
handler returns the result, raises `RefusedError`, or returns `LATER` and answers later through
`CallDispatcher.answer`.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, NamedTuple

import msgspec

from colony.runtime.protocol import topics
from colony.runtime.protocol.connections import Caller, ConnectionRecord
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Effect,
    Malformed,
    Message,
    Notice,
    Problem,
    Reply,
    Right,
    SendMessage,
    Wake,
    WakeAt,
)

LEASE_NS = 750_000_000
"""Nanoseconds without a sign of life after which a connection is lost; a client sends six a second."""

MAX_ANSWER_BYTES = 8 * 1024 * 1024
"""Byte limit of the replies kept for all connections together."""

STOP_DEADLINE_NS = 150_000_000
"""Nanoseconds that a stop may take to reach the devices of a server, before it is refused as not reached."""

STOP_CHECK_NS = 2_000_000
"""Nanoseconds between two checks that a stop has reached the devices."""

STOPS_KEPT = 256
"""Number of replies to emergency stops that are kept, so that a repeated call does not stop again."""

MAX_CONNECTIONS = 1000
"""Maximum number of connections that a server has at a time."""

MAX_CONNECTIONS_PER_USER = 500
"""Maximum number of connections of one user, so that a single user cannot take all of them."""

MAX_LIMIT_MESSAGES = 16
"""Maximum number of messages in `status` about connection limits that were reached."""

MAX_NAME_LENGTH = 255
"""Maximum number of characters of a connection's name; longer names are truncated."""

MAX_WAITING_PER_CONNECTION = 256
"""Maximum number of calls of one connection that may wait for their answers."""

MAX_ARGUMENT_BYTES = 64 * 1024
"""Byte limit of the arguments, in msgpack, for a method that sets no limit of its own."""


MAX_TEXT_LENGTH = 1000
"""Maximum number of characters of a user-readable message; longer ones are truncated."""


class RefusedError(Exception):
    """A call that a server refuses to carry out.

    `code` is for programs: "arguments", "size", "method", "right", "closed", "malformed", "full", or a code
    of the server's own. Further codes are "flood", from the server's inbox, for calls that came too fast;
    "not kept", for an emergency stop that the Clock could not write to its file; and "not reached", for one
    that has not reached a device.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.problem = Problem(code=code, message=message[:MAX_TEXT_LENGTH])


class CallId(NamedTuple):
    """The identity of a call, by which it is answered: its caller and its number."""

    caller: Caller
    number: int


class Later:
    """The type of `LATER`."""


LATER: Final = Later()
"""Result of a handler that answers later."""

EMERGENCY_STOP = "emergency_stop"
"""Name of the method that stops a server's actuators."""

Handler = Callable[[CallId, Any, int], object]
"""A function from the call, its arguments and the time to a result that msgspec can encode."""


class Method(NamedTuple):
    """A method of a server: the struct of its arguments, its handler, and the right that it needs.

    `max_bytes` is the limit of the arguments in bytes. A `lasting` method keeps using the server
    after its answer, such as a subscription: the right to stop does not suffice for it.
    """

    name: str
    arguments: type[msgspec.Struct]
    handler: Handler
    right: Right
    max_bytes: int = MAX_ARGUMENT_BYTES
    lasting: bool = False


def method(
    name: str,
    arguments: type[msgspec.Struct],
    handler: Handler,
    *,
    right: Right = "command",
    max_bytes: int = MAX_ARGUMENT_BYTES,
    lasting: bool = False,
) -> Method:
    """Return a method for a server.

    Arguments of more than `max_bytes` bytes are refused with the code "size" before they are decoded.
    """
    return Method(name, arguments, handler, right, max_bytes, lasting)


class Open(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `open`: the connection's display name. Its priority is that of the call `open`."""

    name: str


class NoArguments(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of a method that takes none."""


class ConnectionStatus(msgspec.Struct, frozen=True, kw_only=True):
    """A connection as its server sees it; `since_ns` is the robot's time at which it was opened."""

    connection: str
    name: str
    priority: int
    since_ns: int
    calls: int
    problems: int
    last_problem: str | None


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """Result of `status`: the connections, and the number of messages that could not be decoded.

    `full` has a message for each limit that is reached, or has been since the server started, and for
    anything else that needs attention. `failing` has a line for each part of a driver, or of a user's server,
    that fails now. `opening` is true while the device is being opened.
    """

    server: str
    connections: tuple[ConnectionStatus, ...]
    malformed: int
    last_malformed: str | None
    full: tuple[str, ...] = ()
    failing: tuple[str, ...] = ()
    opening: bool = False


_RIGHTS: dict[Right, tuple[Right, ...]] = {
    "read": ("read", "command", "stop", "unlimited"),
    "command": ("command",),
    "stop": ("stop", "command"),
    "unlimited": ("unlimited",),
}
"""Claimed rights that suffice for a method, by the right that it needs; commanding includes stopping."""


def right_text(right: Right) -> str:
    """Return what a right allows, as a verb for messages."""
    return "ignore limits" if right == "unlimited" else right


class CallDispatcher:
    """The call handling of one server. Mutable.

    Args:
        server: the server's name.
        methods: the server's methods, in addition to the built-in `open`, `close` and `status`.
        admit: called before a connection opens; raises `RefusedError` to reject it.
        on_lost: called when a connection has ended, by `close` or by its lease; returns effects.
        stop: carries out an emergency stop, given the connection and the time; raises `RefusedError` if it
            could not do all of it. None if the server has nothing to stop.
        unreached: returns a line for each device that the last stop has not reached, or not yet; None if the
            stop is complete when `stop` returns. Otherwise `answer_stops` answers it.
        other_limit_messages: returns messages for `status` about limits reached in other parts of the server.
        failing: returns a line for `status` for each driver, or function of a user, that fails now.
        opening: returns True while the device of the server is being opened.
        lease_ns: nanoseconds without a sign of life after which a connection is lost.
    """

    def __init__(
        self,
        server: str,
        methods: Iterable[Method],
        *,
        admit: Callable[[Caller], None] = lambda caller: None,
        on_lost: Callable[[Caller, int], Iterable[Effect]] = lambda caller, now_ns: (),
        stop: Callable[[str, int], None] | None = None,
        unreached: Callable[[], tuple[str, ...]] | None = None,
        other_limit_messages: Callable[[], Iterable[str]] = lambda: (),
        failing: Callable[[], tuple[str, ...]] = lambda: (),
        opening: Callable[[], bool] = lambda: False,
        lease_ns: int = LEASE_NS,
    ) -> None:
        self._server = server
        self._lease_ns = lease_ns
        self._failing, self._opening = failing, opening
        self._stop = stop
        self._unreached = unreached
        self._unanswered_stops: dict[tuple[str, int], int] = {}
        self._other_limit_messages = other_limit_messages
        built_in = (
            method("open", Open, lambda *_: None, right="read"),
            method("close", NoArguments, lambda *_: None, right="read"),
            method("status", NoArguments, self._status, right="read"),
        )
        self._methods = {m.name: (m, msgspec.msgpack.Decoder(m.arguments)) for m in (*built_in, *methods)}
        self._admit = admit
        self._on_lost = on_lost
        self._connections: dict[str, ConnectionRecord] = {}
        self._stops: OrderedDict[tuple[str, int], Effect] = OrderedDict()
        self._answer_bytes = 0
        self._limit_messages: dict[str, None] = {}
        self._malformed = 0
        self._last_malformed: str | None = None
        self._next_wake_ns: int | None = None
        self.listens = (topics.calls(server),)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Handle a call, a sign of life, a malformed message, or a wake; ignore every other message."""
        match message:
            case Call(method=called) if called == EMERGENCY_STOP and self._stop is not None:
                yield from self._stop_at_once(self._stop, message, now_ns)
            case Call():
                yield from self._call(message, now_ns)
            case Alive():
                connection = self._connections.get(message.connection)
                if connection is not None:
                    connection.last_message_ns = now_ns
                else:
                    yield self._fail(message.connection, 0, _CLOSED)
            case Malformed():
                self._malformed += 1
                self._last_malformed = message.reason[:MAX_TEXT_LENGTH]
                if message.connection is not None:
                    problem = Problem(code="malformed", message=f"{self._server}: {self._last_malformed}")
                    yield self._fail(message.connection, 0, problem)
            case Wake():
                yield from self._expire(now_ns)
            case _:
                pass

    def answer(self, call_id: CallId, result: object) -> Iterator[Effect]:
        """Send the result of a call whose handler returned `LATER`; do nothing if the caller is gone."""
        yield from self._reply(call_id, _result(call_id, result))

    def refuse(self, call_id: CallId, refused: RefusedError) -> Iterator[Effect]:
        """Refuse a call whose handler returned `LATER`; do nothing if the caller is gone."""
        yield from self._reply(call_id, _problem(call_id, refused.problem))

    def settle(self, answers: Iterable[tuple[CallId, object]]) -> Iterator[Effect]:
        """Answer calls whose handlers returned `LATER`; a `RefusedError` refuses its call."""
        for call_id, result in answers:
            if isinstance(result, RefusedError):
                yield from self.refuse(call_id, result)
            else:
                yield from self.answer(call_id, result)

    def answer_stops(self, now_ns: int) -> Iterator[Effect]:
        """Answer the stops that have reached the devices, or have not in `STOP_DEADLINE_NS`.

        To be called after every message, by servers that gave `unreached`.
        """
        if not self._unanswered_stops:
            return
        unreached = () if self._unreached is None else self._unreached()
        for stop_id, since_ns in tuple(self._unanswered_stops.items()):
            problem = None
            if unreached:
                if now_ns < since_ns + STOP_DEADLINE_NS:
                    continue
                text = f"{self._server} is stopped, but the stop has not reached its device"
                problem = Problem(
                    code="not reached", message=f"{text}: {'; '.join(unreached)}"[:MAX_TEXT_LENGTH]
                )
            del self._unanswered_stops[stop_id]
            yield self._answer_stop(*stop_id, problem)
        if self._unanswered_stops:
            yield WakeAt(now_ns + STOP_CHECK_NS)

    def notify(self, caller: Caller, subject: str, body: object) -> Iterator[Effect]:
        """Send a notice to a caller, if it is still connected."""
        if caller.connection in self._connections:
            raw = msgspec.Raw(msgspec.msgpack.encode(body))
            notice = Notice(connection=caller.connection, subject=subject, body=raw)
            yield SendMessage(topics.replies(self._server, caller.connection), notice)

    # --- calls ---------------------------------------------------------------------------------------

    def _stop_at_once(self, stop: Callable[[str, int], None], call: Call, now_ns: int) -> Iterator[Effect]:
        """Carry out an emergency stop, even without an open connection, and regardless of priority.

        A repeated call does not stop again, as the first stop may have been released in the meantime.
        """
        stop_id = call.connection, call.number
        if (earlier_reply := self._stops.get(stop_id)) is not None:
            yield earlier_reply
            return
        if stop_id in self._unanswered_stops:
            return
        if call.right == "read":
            text = f"{self._server}.{EMERGENCY_STOP} needs the right to stop, not to read"
            yield self._fail(*stop_id, Problem(code="right", message=text))
            return
        connection = self._connections.get(call.connection)
        if connection is not None:
            connection.last_message_ns = now_ns
            connection.calls += 1
        try:
            stop(call.connection, now_ns)
        except RefusedError as refused:
            yield self._answer_stop(*stop_id, refused.problem)
        else:
            if self._unreached is None:
                yield self._answer_stop(*stop_id, None)
            else:
                self._unanswered_stops[stop_id] = now_ns

    def _answer_stop(self, connection: str, number: int, problem: Problem | None) -> Effect:
        reply = Reply(connection=connection, number=number, problem=problem)
        sent = self._stops[connection, number] = SendMessage(topics.replies(self._server, connection), reply)
        if len(self._stops) > STOPS_KEPT:
            self._stops.popitem(last=False)
        return sent

    def _call(self, call: Call, now_ns: int) -> Iterator[Effect]:
        connection = self._connections.get(call.connection)
        if connection is None and call.method == "open":
            connection, problem = self._open(call, now_ns)
            if connection is None:
                yield self._fail(call.connection, call.number, problem)
                return
            yield from self._schedule_expiry(now_ns)
        if connection is None:
            yield self._fail(call.connection, call.number, _CLOSED)
            return
        connection.last_message_ns = now_ns
        number = call.number
        if number in connection.answers:
            yield SendMessage(topics.replies(self._server, call.connection), connection.answers[number])
        elif number not in connection.pending and number > connection.highest_dropped:
            full = len(connection.pending) >= MAX_WAITING_PER_CONNECTION
            connection.pending.add(number)
            connection.calls += 1
            if full:
                text = (
                    f"{self._server}: this connection already has {MAX_WAITING_PER_CONNECTION} waiting calls"
                )
                yield from self.refuse(CallId(connection.caller, number), RefusedError("full", text))
            else:
                yield from self._execute(connection, call, now_ns)

    def _execute(self, connection: ConnectionRecord, call: Call, now_ns: int) -> Iterator[Effect]:
        call_id = CallId(connection.caller, call.number)
        entry = self._methods.get(call.method)
        # answers to reads may be large, so they are not kept: a repeated read is executed again
        kept = entry is not None and entry[0].right != "read"
        try:
            result = self._result_of(call_id, call, now_ns)
        except RefusedError as refused:
            yield from self._reply(call_id, _problem(call_id, refused.problem), kept=kept)
            return
        if not isinstance(result, Later):
            yield from self._reply(call_id, _result(call_id, result), kept=kept)
        if call.method == "close":
            yield from self._end(call.connection, now_ns)

    def _result_of(self, call_id: CallId, call: Call, now_ns: int) -> object:
        entry = self._methods.get(call.method)
        if entry is None:
            available, name = ", ".join(self._methods), call.method[:MAX_NAME_LENGTH]
            raise RefusedError("method", f"{self._server} has no method `{name}`; it has {available}")
        called, decoder = entry
        where = f"{self._server}.{called.name}"
        if call.right not in _RIGHTS[called.right] or (called.lasting and call.right == "stop"):
            needed, claimed = right_text(called.right), right_text(call.right)
            raise RefusedError("right", f"{where} needs the right to {needed}, not to {claimed}")
        if call.priority != call_id.caller.priority:
            priority = call_id.caller.priority
            raise RefusedError(
                "arguments", f"{where}: the connection has priority {priority}, not {call.priority}"
            )
        size = len(memoryview(call.arguments))
        if size > called.max_bytes:
            raise RefusedError(
                "size", f"{where}: {size} bytes of arguments; expected at most {called.max_bytes}"
            )
        try:
            arguments = decoder.decode(call.arguments)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
            raise RefusedError("arguments", f"{where}: {problem}") from None
        return called.handler(call_id, arguments, now_ns)

    def _open(self, call: Call, now_ns: int) -> tuple[ConnectionRecord | None, Problem]:
        try:
            opening = msgspec.msgpack.decode(call.arguments, type=Open)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
            return None, Problem(code="arguments", message=f"{self._server}.open: {problem}")
        user = topics.user_of(call.connection)
        if len(self._connections) >= MAX_CONNECTIONS:
            return None, self._no_room(f"{self._server} already has {MAX_CONNECTIONS} connections")
        if sum(c.caller.user == user for c in self._connections.values()) >= MAX_CONNECTIONS_PER_USER:
            return None, self._no_room(
                f"{self._server} has {MAX_CONNECTIONS_PER_USER} connections of {user} already"
            )
        caller = Caller(call.connection, opening.name[:MAX_NAME_LENGTH], call.priority, user)
        try:
            self._admit(caller)
        except RefusedError as refused:
            return None, refused.problem
        connection = ConnectionRecord(caller=caller, since_ns=now_ns, last_message_ns=now_ns)
        self._connections[call.connection] = connection
        return connection, _CLOSED

    def _no_room(self, text: str) -> Problem:
        self._note_limit(text)
        return Problem(code="full", message=text)

    def _note_limit(self, message: str) -> None:
        if len(self._limit_messages) < MAX_LIMIT_MESSAGES:
            self._limit_messages[message] = None

    def _reply(self, call_id: CallId, reply: Reply, *, kept: bool = True) -> Iterator[Effect]:
        connection = self._connections.get(call_id.caller.connection)
        if connection is None:
            return
        connection.pending.discard(reply.number)
        if kept:
            self._answer_bytes += connection.keep_answer(reply)
            if self._answer_bytes > MAX_ANSWER_BYTES:
                self._drop_answers()
        if reply.problem is not None:
            connection.problems += 1
            connection.last_problem = reply.problem.message
        yield SendMessage(topics.replies(self._server, call_id.caller.connection), reply)

    def _drop_answers(self) -> None:
        """Drop answers of the connection with the most bytes of answers, oldest first, all if necessary."""
        largest = max(self._connections.values(), key=lambda connection: connection.answer_bytes)
        while self._answer_bytes > MAX_ANSWER_BYTES and largest.answers:
            self._answer_bytes -= largest.drop_oldest_answer()
        self._note_limit(
            f"{self._server} keeps {MAX_ANSWER_BYTES >> 20} MiB of answers, and forgets the oldest"
        )

    def _fail(self, connection: str, number: int, problem: Problem) -> Effect:
        reply = Reply(connection=connection, number=number, problem=problem)
        return SendMessage(topics.replies(self._server, connection), reply)

    def _status(self, call_id: CallId, arguments: object, now_ns: int) -> Status:
        return Status(
            server=self._server,
            connections=tuple(
                ConnectionStatus(
                    connection=c.caller.connection,
                    name=c.caller.name,
                    priority=c.caller.priority,
                    since_ns=c.since_ns,
                    calls=c.calls,
                    problems=c.problems,
                    last_problem=c.last_problem,
                )
                for c in self._connections.values()
            ),
            malformed=self._malformed,
            last_malformed=self._last_malformed,
            full=(*self._limit_messages, *self._other_limit_messages()),
            failing=self._failing(),
            opening=self._opening(),
        )

    # --- leases --------------------------------------------------------------------------------------

    def _schedule_expiry(self, now_ns: int) -> Iterator[Effect]:
        """Schedule a wake for the earliest time at which a lease could expire."""
        if not self._connections:
            self._next_wake_ns = None
            return
        due = min(c.last_message_ns for c in self._connections.values()) + self._lease_ns + 1
        if self._next_wake_ns is None or now_ns >= self._next_wake_ns or due < self._next_wake_ns:
            self._next_wake_ns = max(due, now_ns + 1)
            yield WakeAt(self._next_wake_ns)

    def _expire(self, now_ns: int) -> Iterator[Effect]:
        if self._next_wake_ns is None or now_ns < self._next_wake_ns:
            return
        expired = [k for k, c in self._connections.items() if now_ns - c.last_message_ns > self._lease_ns]
        for connection in expired:
            yield from self._end(connection, now_ns)
            yield self._fail(connection, 0, _CLOSED)
        yield from self._schedule_expiry(now_ns)

    def _end(self, connection: str, now_ns: int) -> Iterator[Effect]:
        ended = self._connections.pop(connection)
        self._answer_bytes -= ended.answer_bytes
        yield from self._on_lost(ended.caller, now_ns)


_CLOSED = Problem(code="closed", message="the connection is not open, or was lost")


def _result(call_id: CallId, result: object) -> Reply:
    raw = msgspec.Raw(msgspec.msgpack.encode(result))
    return Reply(connection=call_id.caller.connection, number=call_id.number, result=raw)


def _problem(call_id: CallId, problem: Problem) -> Reply:
    return Reply(connection=call_id.caller.connection, number=call_id.number, problem=problem)
