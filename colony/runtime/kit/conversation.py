"""The client's end of a connection as pure logic: messages and times in, effects out.

A connection has an id of its own. When the server goes away, or no longer knows the connection (after a
restart, or because the lease expired), the client reopens it under the same id and continues the numbering of
its calls. So a server that records its answers (DServer) recognizes calls that it completed before.
Repeatable calls are then sent again, each with its number; the others fail with `ConnectionLostError`. A call
without an answer, or refused with the code "flood", is sent again with the same number after increasing
pauses, and is executed once. An emergency stop does not wait for the connection to open.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from typing import Any, NamedTuple, TypeVar

import msgspec

from colony.backoff import Backoff
from colony.runtime.kit.errors import CallRefusedError, ConnectionLostError, RobotConnectionError
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import EMERGENCY_STOP, NoArguments, Open
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.protocol.messages import Alive, Call, Notice, Reply, Right

# --- conversation --------------------------------------------------------------------------------------


KEEPALIVE_NS = 150_000_000
"""Nanoseconds without a message after which a sign of life is due; checking every 100 ms suffices."""

FIRST_RESEND_PAUSE_NS = 250_000_000
"""Nanoseconds without an answer before a call is first resent; each further pause is twice as long."""

MAX_RESEND_PAUSE_NS = 2_000_000_000

MAX_ARGUMENT_BYTES = MAX_MESSAGE_BYTES - 1024
"""Byte limit of the arguments of a call, which leaves room for its other fields."""

Outcome = msgspec.Raw | RobotConnectionError
"""The result of a call in msgpack, or its error."""


@dataclass(frozen=False, slots=True, eq=False)
class Pending:
    """A call without an answer; `resolve` is called once, with its outcome.

    Raises:
        TypeError: the arguments cannot be encoded.
        CallRefusedError: the arguments are too large.
    """

    call: CallRequest[Any]
    resolve: Callable[[Outcome], None]
    arguments: bytes = b""
    message: Call | None = None
    sent_ns: int = 0
    resends: Backoff[int] = field(default_factory=lambda: Backoff(FIRST_RESEND_PAUSE_NS, MAX_RESEND_PAUSE_NS))

    def __post_init__(self) -> None:
        """Encode the arguments and check their size."""
        self.arguments = msgspec.msgpack.encode(self.call.arguments)
        if len(self.arguments) > MAX_ARGUMENT_BYTES:
            found = f"the arguments are {len(self.arguments)} bytes; expected at most {MAX_ARGUMENT_BYTES}"
            raise CallRefusedError("size", f"{self.call.method}: {found}")


class Listen(NamedTuple):
    """Effect: listen to replies to `connection` from now on, in place of an earlier one."""

    connection: str


class Transmit(NamedTuple):
    """Effect: send a message to the server."""

    message: Call | Alive


class Resolve(NamedTuple):
    """Effect: report the outcome of a call."""

    pending: Pending
    outcome: Outcome


class Deliver(NamedTuple):
    """Effect: pass on a notice of the server."""

    notice: Notice


Effect = Listen | Transmit | Resolve | Deliver


class ConversationState(Enum):
    """The state of a connection."""

    OPENING = "opening"
    OPEN = "open"
    CLOSED = "closed"


@dataclass(frozen=False, slots=True)
class Conversation:
    """The client's half of a connection. Mutable.

    Args:
        server: the name of the server.
        user: the user of this process.
        new_id: function that returns a new id each time.
        name: the display name of the connection.
        priority: the priority of all its calls.
        default_right: a right of the user, claimed by calls that any right allows.
    """

    server: str
    user: str
    new_id: Callable[[], str]
    name: str
    priority: int
    default_right: Right = "read"
    state: ConversationState = ConversationState.CLOSED
    connection: str = ""
    openings: int = 0
    server_error: str = ""
    _number: int = 0
    _opening: Pending | None = None
    _sent: dict[int, Pending] = field(default_factory=dict)
    _unsent: list[Pending] = field(default_factory=list)
    _repeated_on_reopen: list[CallRequest[Any]] = field(default_factory=list)
    _last_sent_ns: int = 0

    def open(self, resolve: Callable[[Outcome], None], now_ns: int) -> Iterator[Effect]:
        """Open the connection, for the first time or again."""
        self.state = ConversationState.OPENING
        if not self.connection:
            self.connection = f"{self.user}/{self.new_id()}"
            yield Listen(self.connection)
        call = CallRequest("open", Open(name=self.name), None, self.default_right, repeatable=True)
        self._opening = Pending(call, resolve)
        yield self._transmit(self._opening, now_ns)

    def submit(self, pending: Pending, now_ns: int) -> Iterator[Effect]:
        """Make a call, now or when the connection is open again."""
        match self.state:
            case ConversationState.OPEN:
                yield self._transmit(pending, now_ns)
            case ConversationState.OPENING if _is_urgent(pending):
                yield self._transmit(pending, now_ns)
            case ConversationState.OPENING:
                self._unsent.append(pending)
            case ConversationState.CLOSED:
                yield Resolve(pending, ConnectionLostError(f"the connection to {self.server} was closed"))

    def repeat_on_reopen(self, call: CallRequest[Any]) -> None:
        """Make this call again whenever the connection is reopened."""
        self._repeated_on_reopen.append(call)

    def forget(self, pending: Pending) -> None:
        """Drop a call whose answer is no longer awaited."""
        if pending.message is not None:
            self._sent.pop(pending.message.number, None)
        elif pending in self._unsent:
            self._unsent.remove(pending)

    def resend(self, pending: Pending, now_ns: int) -> Iterator[Effect]:
        """Resend a call without an answer immediately."""
        if pending.message is not None and pending.message.number in self._sent:
            yield self._transmit(pending, now_ns)

    def receive(self, message: Reply | Notice, now_ns: int) -> Iterator[Effect]:
        """Handle a reply or notice from the server; ignore one for another connection."""
        if message.connection != self.connection or self.state is ConversationState.CLOSED:
            return
        if isinstance(message, Notice):
            yield Deliver(message)
        elif message.problem is not None and message.problem.code == "closed":
            if self.state is ConversationState.OPEN:  # otherwise, the reply is to an earlier message
                yield from self.reopen(now_ns)
        elif message.number == 0:
            self.server_error = "" if message.problem is None else message.problem.message
        else:
            yield from self._on_reply(message, now_ns)

    def reopen(self, now_ns: int) -> Iterator[Effect]:
        """Reopen the connection, which the server no longer has."""
        if self.state is ConversationState.CLOSED:
            return
        lost = ConnectionLostError(
            f"the connection to {self.server} was lost before the answer; it is unknown whether the call "
            "was executed, so it is not repeated"
        )
        yield from self._fail_unrepeatable(lost)
        opening = self._opening
        resolve = opening.resolve if opening is not None else _ignore
        yield from self.open(resolve, now_ns)

    def server_lost(self) -> Iterator[Effect]:
        """Handle the loss of the server: fail the calls that cannot be repeated."""
        if self.state is not ConversationState.CLOSED:
            lost = ConnectionLostError(
                f"{self.server} went away before it answered; it is unknown whether the call was "
                "executed, so it is not repeated"
            )
            yield from self._fail_unrepeatable(lost)

    def server_found(self, now_ns: int) -> Iterator[Effect]:
        """Handle the return of the server: check immediately whether it knows this connection."""
        if self.state is ConversationState.OPEN:
            yield self._keepalive(now_ns)
        elif self.state is ConversationState.OPENING and self._opening is not None:
            yield self._transmit(self._opening, now_ns)

    def poll(self, now_ns: int) -> Iterator[Effect]:
        """Resend calls and send a sign of life, if due; to be called often."""
        if self.state is ConversationState.CLOSED:
            return
        unanswered = tuple(self._sent.values())
        if self._opening is not None:
            unanswered = (self._opening, *filter(_is_urgent, unanswered))
        for pending in unanswered:
            if now_ns - pending.sent_ns >= pending.resends.pause:
                pending.resends.next()
                yield self._transmit(pending, now_ns)
        if self.state is ConversationState.OPEN and now_ns - self._last_sent_ns >= KEEPALIVE_NS:
            yield self._keepalive(now_ns)

    def close(self, now_ns: int) -> Iterator[Effect]:
        """Close the connection: notify the server, and fail the calls without an answer."""
        if self.state is ConversationState.OPEN:
            call = CallRequest("close", NoArguments(), None, self.default_right)
            yield self._transmit(Pending(call, _ignore), now_ns)
        self.state = ConversationState.CLOSED
        ended = ConnectionLostError(f"the connection to {self.server} was closed before the answer")
        for pending in (*self._sent.values(), *self._unsent):
            yield Resolve(pending, ended)
        self._sent.clear()
        self._unsent.clear()

    # --- internals -----------------------------------------------------------------------------------

    def _on_reply(self, reply: Reply, now_ns: int) -> Iterator[Effect]:
        outcome: Outcome = reply.result
        if reply.problem is not None and reply.problem.code == "flood":
            self.server_error = reply.problem.message
            return  # the call was not executed, and is sent again later
        if reply.problem is not None:
            outcome = CallRefusedError(reply.problem.code, reply.problem.message)
        opening = self._opening
        if opening is not None and opening.message is not None and reply.number == opening.message.number:
            if isinstance(outcome, RobotConnectionError):
                self.server_error = str(outcome)
            else:
                self._opening = None
                yield from self._on_opened(now_ns)
            yield Resolve(opening, outcome)
        elif (pending := self._sent.pop(reply.number, None)) is not None:
            yield Resolve(pending, outcome)

    def _on_opened(self, now_ns: int) -> Iterator[Effect]:
        self.state = ConversationState.OPEN
        self.openings += 1
        self.server_error = ""
        resend = tuple(self._sent.values())
        if self.openings > 1:
            for call in self._repeated_on_reopen:
                yield self._transmit(Pending(call, _ignore), now_ns)
        for pending in resend:
            yield self._transmit(pending, now_ns)
        unsent, self._unsent = self._unsent, []
        for pending in unsent:
            yield self._transmit(pending, now_ns)

    def _fail_unrepeatable(self, lost: ConnectionLostError) -> Iterator[Effect]:
        """Fail the open calls that cannot be repeated."""
        for number, pending in tuple(self._sent.items()):
            if not pending.call.repeatable:
                del self._sent[number]
                yield Resolve(pending, lost)

    def _transmit(self, pending: Pending, now_ns: int) -> Effect:
        if pending.message is None:
            self._number += 1
            call = pending.call
            pending.message = Call(
                connection=self.connection,
                number=self._number,
                method=call.method,
                arguments=msgspec.Raw(pending.arguments),
                priority=self.priority,
                right=self.default_right if call.right == "read" else call.right,
            )
            if pending is not self._opening:
                self._sent[self._number] = pending
        pending.sent_ns = self._last_sent_ns = now_ns
        return Transmit(pending.message)

    def _keepalive(self, now_ns: int) -> Effect:
        self._last_sent_ns = now_ns
        return Transmit(Alive(connection=self.connection))


def _is_urgent(pending: Pending) -> bool:
    """Return True if a call is sent before the connection is open."""
    return pending.call.method == EMERGENCY_STOP


def _ignore(outcome: Outcome) -> None:
    """Ignore an outcome."""


# --- answers -------------------------------------------------------------------------------------------
#
# Timeouts and results of calls, for all kinds of connections.


T = TypeVar("T")

TIMEOUT_S = 5.0
"""Default timeout of a call, in seconds."""


def answer_timeout(call: CallRequest[Any], requested_s: float | None, default_s: float) -> float:
    """Return the timeout in seconds: `requested_s`; if None, `default_s`, or longer if the call needs it.

    Raises:
        TypeError: `call` is not a call of a library.
    """
    if not isinstance(call, CallRequest):
        hint = ": call it" if callable(call) else ""
        raise TypeError(
            f"not a call: {call!r}{hint}; expected the result of a library function, such as robot.go(200)"
        )
    if requested_s is not None:
        return requested_s
    return default_s if call.wait_s is None else max(default_s, call.wait_s)


def read_result(server: str, call: CallRequest[T], outcome: Outcome) -> T:
    """Return the result of a call.

    Raises:
        CallRefusedError, ConnectionLostError: the call has no result.
    """
    if isinstance(outcome, RobotConnectionError):
        raise outcome
    try:
        result: T = _decoder(call.reply).decode(outcome)
    except msgspec.DecodeError as problem:
        text = f"{server}.{call.method} returned an invalid result: {problem}"
        raise CallRefusedError("reply", text) from None
    return result


@lru_cache(maxsize=256)
def _decoder(result: Any) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(result)
