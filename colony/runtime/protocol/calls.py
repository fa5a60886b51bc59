"""Call handling of a server: connections with priorities, typed methods, replies, and callers that die.

The calls are those of thesis section 4.5.3. A server lists its methods and gives its messages to a
`CallDesk`:

    METHODS = (method("level", Level, read_level, right="read"), ...)
    desk = CallDesk("Battery", METHODS)
    effects = desk.handle(message, now_ns)

A connection begins with the call `open` and ends with the call `close`, or when its lease expires. A call
that changes something is done once however often it arrives: a repeated call gets the same answer again. A
handler returns the result, raises `RefusedError`, or returns `LATER` and answers later through
`CallDesk.answer`.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, NamedTuple

import msgspec

from colony.runtime.protocol import topics
from colony.runtime.protocol.connections import Caller, Connection
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
    Send,
    Wake,
    WakeAt,
)

LEASE_NS = 750_000_000
"""Lease of a connection, in ns: it is lost after that time without a sign of life (clients send 4 per s)."""

ANSWER_BYTES = 8 * 1024 * 1024
"""Byte limit of the replies kept for all connections together."""

STOPS_KEPT = 256
"""Number of replies to emergency stops that are kept, so that a repeated call is not a second stop."""

CONNECTIONS = 1000
"""Largest number of connections that a server has at a time."""

CONNECTIONS_EACH = 500
"""Largest number of connections of one user, so that a single user cannot take all of them."""

MOST_REACHED = 16
"""Largest number of sentences in `status` about connection limits that were reached."""

LONGEST_NAME = 255
"""Largest number of characters of a connection's name; longer names are truncated."""

WAITING_EACH = 256
"""Largest number of calls of one connection that may wait for their answers."""

ARGUMENT_BYTES = 64 * 1024
"""Largest size of the arguments, in bytes of msgpack, for a method that sets no limit of its own."""


LONGEST_TEXT = 1000
"""Largest number of characters of a message for people; longer ones are truncated."""


class RefusedError(Exception):
    """A call that a server refuses to carry out.

    `code` is for programs: "arguments", "size", "method", "right", "closed", "malformed", "full", or one of
    the server's own. Further codes are "flood", from the server's inbox, for a call that came too fast, and
    "not kept", for an emergency stop that the Clock could not write to its file.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.problem = Problem(code=code, message=message[:LONGEST_TEXT])


class Asked(NamedTuple):
    """A call whose answer is due."""

    caller: Caller
    number: int


class Later:
    """The type of `LATER`."""


LATER: Final = Later()
"""Result of a handler that answers later."""

EMERGENCY_STOP = "emergency_stop"
"""Name of the method that stops a server's actuators."""

Handler = Callable[[Asked, Any, int], object]
"""A function from the call, its arguments and the time to a result that msgspec can encode."""


class Method(NamedTuple):
    """A method of a server: the struct of its arguments, its handler, and the right that it needs.

    `largest` is the limit of the arguments in bytes. A `lasting` method continues to cost the server
    something after its answer: the right to stop does not suffice for it.
    """

    name: str
    arguments: type[msgspec.Struct]
    handler: Handler
    right: Right
    largest: int = ARGUMENT_BYTES
    lasting: bool = False


def method(
    name: str,
    arguments: type[msgspec.Struct],
    handler: Handler,
    *,
    right: Right = "command",
    largest: int = ARGUMENT_BYTES,
    lasting: bool = False,
) -> Method:
    """Return an entry of a server's method table.

    Arguments of more than `largest` bytes are refused with the code "size" before they are decoded.
    """
    return Method(name, arguments, handler, right, largest, lasting)


class Open(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments of `open`: the connection's name, for people. Its priority is that of the call."""

    name: str


class Nothing(msgspec.Struct, frozen=True, kw_only=True):
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

    `full` has a sentence for each limit of the server that is reached, or was since it started, and for
    anything else that needs attention.
    """

    server: str
    connections: tuple[ConnectionStatus, ...]
    malformed: int
    last_malformed: str | None
    full: tuple[str, ...] = ()


_RIGHTS: dict[Right, tuple[Right, ...]] = {
    "read": ("read", "command", "stop"),
    "command": ("command",),
    "stop": ("stop", "command"),
}
"""Rights with which a method of each kind may be called; the right to command includes stopping."""


class CallDesk:
    """The call handling of one server. Mutable: the connections and the replies sent to them.

    Args:
        server: the server's name.
        methods: the server's methods, besides the built-in `open`, `close` and `status`.
        admit: called before a connection opens; raises `RefusedError` to reject it.
        lost: called when a connection ended, by `close` or by its lease; returns effects.
        stop: carries out an emergency stop, given the connection and the time; raises `RefusedError` if it
            could not do all of it. Without it the server has nothing to stop.
        full: returns sentences about limits that the server's other parts have reached, for `status`.
    """

    def __init__(
        self,
        server: str,
        methods: Iterable[Method],
        *,
        admit: Callable[[Caller], None] = lambda caller: None,
        lost: Callable[[Caller, int], Iterable[Effect]] = lambda caller, now_ns: (),
        stop: Callable[[str, int], None] | None = None,
        full: Callable[[], Iterable[str]] = lambda: (),
    ) -> None:
        self._server = server
        self._stop = stop
        self._full = full
        own = (
            method("open", Open, lambda *_: None, right="read"),
            method("close", Nothing, lambda *_: None, right="read"),
            method("status", Nothing, self._status, right="read"),
        )
        self._methods = {m.name: (m, msgspec.msgpack.Decoder(m.arguments)) for m in (*own, *methods)}
        self._admit = admit
        self._lost = lost
        self._connections: dict[str, Connection] = {}
        self._stops: OrderedDict[tuple[str, int], Effect] = OrderedDict()
        self._answer_bytes = 0
        self._reached: dict[str, None] = {}
        self._malformed = 0
        self._last_malformed: str | None = None
        self._alarm: int | None = None
        self.listens = (topics.calls(server),)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Handle a call, a sign of life, a malformed message, or a wake; ignore every other message."""
        match message:
            case Call(method=called) if called == EMERGENCY_STOP and self._stop is not None:
                yield self._stop_at_once(self._stop, message, now_ns)
            case Call():
                yield from self._call(message, now_ns)
            case Alive():
                connection = self._connections.get(message.connection)
                if connection is not None:
                    connection.heard_ns = now_ns
                else:
                    yield self._fail(message.connection, 0, _CLOSED)
            case Malformed():
                self._malformed += 1
                self._last_malformed = message.reason[:LONGEST_TEXT]
                if message.connection is not None:
                    problem = Problem(code="malformed", message=f"{self._server}: {self._last_malformed}")
                    yield self._fail(message.connection, 0, problem)
            case Wake():
                yield from self._expire(now_ns)
            case _:
                pass

    def answer(self, asked: Asked, result: object) -> Iterator[Effect]:
        """Send the result of a call whose handler returned `LATER`; do nothing if the caller is gone."""
        yield from self._reply(asked, _result(asked, result))

    def refuse(self, asked: Asked, refused: RefusedError) -> Iterator[Effect]:
        """Refuse a call whose handler returned `LATER`; do nothing if the caller is gone."""
        yield from self._reply(asked, _problem(asked, refused.problem))

    def settle(self, answers: Iterable[tuple[Asked, object]]) -> Iterator[Effect]:
        """Answer calls whose handlers returned `LATER`; a `RefusedError` refuses its call."""
        for asked, result in answers:
            if isinstance(result, RefusedError):
                yield from self.refuse(asked, result)
            else:
                yield from self.answer(asked, result)

    def notify(self, caller: Caller, subject: str, body: object) -> Iterator[Effect]:
        """Send a notice to a caller, if it is still connected."""
        if caller.connection in self._connections:
            raw = msgspec.Raw(msgspec.msgpack.encode(body))
            notice = Notice(connection=caller.connection, subject=subject, body=raw)
            yield Send(topics.replies(self._server, caller.connection), notice)

    # --- calls ---------------------------------------------------------------------------------------

    def _stop_at_once(self, stop: Callable[[str, int], None], call: Call, now_ns: int) -> Effect:
        """Carry out an emergency stop, also without an open connection and regardless of priority.

        A repeated call is not a second stop: the robot may have been released in the meantime.
        """
        known = self._stops.get((call.connection, call.number))
        if known is not None:
            return known
        if call.right == "read":
            text = f"{self._server}.{EMERGENCY_STOP} needs the right to stop, not to read"
            return self._fail(call.connection, call.number, Problem(code="right", message=text))
        connection = self._connections.get(call.connection)
        if connection is not None:
            connection.heard_ns = now_ns
            connection.calls += 1
        try:
            stop(call.connection, now_ns)
        except RefusedError as refused:
            sent = self._fail(call.connection, call.number, refused.problem)
        else:
            reply = Reply(connection=call.connection, number=call.number)
            sent = Send(topics.replies(self._server, call.connection), reply)
        self._stops[call.connection, call.number] = sent
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
            yield from self._watch(now_ns)
        if connection is None:
            yield self._fail(call.connection, call.number, _CLOSED)
            return
        connection.heard_ns = now_ns
        number = call.number
        if number in connection.answers:
            yield Send(topics.replies(self._server, call.connection), connection.answers[number])
        elif number not in connection.pending and number > connection.forgotten:
            full = len(connection.pending) >= WAITING_EACH
            connection.pending.add(number)
            connection.calls += 1
            if full:
                text = f"{self._server}: {WAITING_EACH} calls of this connection wait for answers already"
                yield from self.refuse(Asked(connection.caller, number), RefusedError("full", text))
            else:
                yield from self._do(connection, call, now_ns)

    def _do(self, connection: Connection, call: Call, now_ns: int) -> Iterator[Effect]:
        asked = Asked(connection.caller, call.number)
        known = self._methods.get(call.method)
        # a repeated read is carried out again instead of kept: its answer may be large
        kept = known is not None and known[0].right != "read"
        try:
            result = self._result_of(asked, call, now_ns)
        except RefusedError as refused:
            yield from self._reply(asked, _problem(asked, refused.problem), kept=kept)
            return
        if not isinstance(result, Later):
            yield from self._reply(asked, _result(asked, result), kept=kept)
        if call.method == "close":
            yield from self._end(call.connection, now_ns)

    def _result_of(self, asked: Asked, call: Call, now_ns: int) -> object:
        found = self._methods.get(call.method)
        if found is None:
            known, name = ", ".join(self._methods), call.method[:LONGEST_NAME]
            raise RefusedError("method", f"{self._server} has no method `{name}`; it has {known}")
        called, decoder = found
        where = f"{self._server}.{called.name}"
        if call.right not in _RIGHTS[called.right] or (called.lasting and call.right == "stop"):
            raise RefusedError("right", f"{where} needs the right to {called.right}, not to {call.right}")
        if call.priority != asked.caller.priority:
            mine = asked.caller.priority
            raise RefusedError(
                "arguments", f"{where}: the connection has priority {mine}, not {call.priority}"
            )
        size = len(memoryview(call.arguments))
        if size > called.largest:
            raise RefusedError(
                "size", f"{where}: {size} bytes of arguments; expected at most {called.largest}"
            )
        try:
            arguments = decoder.decode(call.arguments)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
            raise RefusedError("arguments", f"{where}: {problem}") from None
        return called.handler(asked, arguments, now_ns)

    def _open(self, call: Call, now_ns: int) -> tuple[Connection | None, Problem]:
        try:
            opening = msgspec.msgpack.decode(call.arguments, type=Open)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
            return None, Problem(code="arguments", message=f"{self._server}.open: {problem}")
        user = topics.user_of(call.connection)
        if len(self._connections) >= CONNECTIONS:
            return None, self._no_room(f"{self._server} has {CONNECTIONS} connections already")
        if sum(c.caller.user == user for c in self._connections.values()) >= CONNECTIONS_EACH:
            return None, self._no_room(f"{self._server} has {CONNECTIONS_EACH} connections of {user} already")
        caller = Caller(call.connection, opening.name[:LONGEST_NAME], call.priority, user)
        try:
            self._admit(caller)
        except RefusedError as refused:
            return None, refused.problem
        connection = Connection(caller=caller, since_ns=now_ns, heard_ns=now_ns)
        self._connections[call.connection] = connection
        return connection, _CLOSED

    def _no_room(self, text: str) -> Problem:
        self._note(text)
        return Problem(code="full", message=text)

    def _note(self, reached: str) -> None:
        if len(self._reached) < MOST_REACHED:
            self._reached[reached] = None

    def _reply(self, asked: Asked, reply: Reply, *, kept: bool = True) -> Iterator[Effect]:
        connection = self._connections.get(asked.caller.connection)
        if connection is None:
            return
        connection.pending.discard(reply.number)
        if kept:
            self._answer_bytes += connection.keep(reply)
            if self._answer_bytes > ANSWER_BYTES:
                self._forget_answers()
        if reply.problem is not None:
            connection.problems += 1
            connection.last_problem = reply.problem.message
        yield Send(topics.replies(self._server, asked.caller.connection), reply)

    def _forget_answers(self) -> None:
        """Drop answers of the connection with the most of them, oldest first, perhaps even the newest."""
        most = max(self._connections.values(), key=lambda each: each.answer_bytes)
        while self._answer_bytes > ANSWER_BYTES and most.answers:
            self._answer_bytes -= most.forget_oldest()
        self._note(f"{self._server} keeps {ANSWER_BYTES >> 20} MiB of answers, and forgets the oldest")

    def _fail(self, connection: str, number: int, problem: Problem) -> Effect:
        reply = Reply(connection=connection, number=number, problem=problem)
        return Send(topics.replies(self._server, connection), reply)

    def _status(self, asked: Asked, arguments: object, now_ns: int) -> Status:
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
            full=(*self._reached, *self._full()),
        )

    # --- leases --------------------------------------------------------------------------------------

    def _watch(self, now_ns: int) -> Iterator[Effect]:
        """Schedule a wake for the time at which the next connection could be lost."""
        if not self._connections:
            self._alarm = None
            return
        due = min(c.heard_ns for c in self._connections.values()) + LEASE_NS + 1
        if self._alarm is None or now_ns >= self._alarm or due < self._alarm:
            self._alarm = max(due, now_ns + 1)
            yield WakeAt(self._alarm)

    def _expire(self, now_ns: int) -> Iterator[Effect]:
        if self._alarm is None or now_ns < self._alarm:
            return
        dead = [k for k, c in self._connections.items() if now_ns - c.heard_ns > LEASE_NS]
        for connection in dead:
            yield from self._end(connection, now_ns)
            yield self._fail(connection, 0, _CLOSED)
        yield from self._watch(now_ns)

    def _end(self, connection: str, now_ns: int) -> Iterator[Effect]:
        ended = self._connections.pop(connection)
        self._answer_bytes -= ended.answer_bytes
        yield from self._lost(ended.caller, now_ns)


_CLOSED = Problem(code="closed", message="the connection is not open, or was lost")


def _result(asked: Asked, result: object) -> Reply:
    raw = msgspec.Raw(msgspec.msgpack.encode(result))
    return Reply(connection=asked.caller.connection, number=asked.number, result=raw)


def _problem(asked: Asked, problem: Problem) -> Reply:
    return Reply(connection=asked.caller.connection, number=asked.number, problem=problem)
