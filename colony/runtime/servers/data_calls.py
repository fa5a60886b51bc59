"""The methods of DServer, called by the functions of `library/data.py` (thesis section 4.6.1).

Each part (variables, semaphores, watches, answers) puts its changes into one journal, which the server
commits before any effect leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Any

import msgspec

from colony.runtime.library.data import (
    CreateSemaphore,
    Dated,
    Get,
    GetMany,
    History,
    ListNames,
    Named,
    Publish,
    SemaphoreState,
    Set,
    SetHistory,
    SetMany,
    Wait,
    Watch,
)
from colony.runtime.protocol.calls import LATER, Asked, CallDesk, Handler, Later, Method, Refused, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.fields import DSERVER
from colony.runtime.protocol.messages import Effect, Message, Wake, WakeAt
from colony.runtime.servers.naming import Names, named
from colony.runtime.servers.once import Answers
from colony.runtime.servers.semaphores import Semaphores, timed_out
from colony.runtime.servers.showing import Wanted
from colony.runtime.servers.telling import PAUSE_NS, Telling
from colony.runtime.servers.variables import (
    READ_BYTES,
    VALUE_BYTES,
    Dating,
    Prepared,
    Variables,
    prepared,
    unknown,
)
from colony.runtime.servers.watching import Watches

RETURN_NS = 2_000_000_000
"""After a restart, what a connection holds is kept for so long, for it to come back. Shorter than that, and
somebody who is about to return might find that another has it too."""

REPLY_BYTES = 3 << 20
"""Bytes of values in one reply, so that it fits into a message."""

MOST_NAMES = 5000
"""Names in one reply."""

MOST_VALUES = 2000
"""Values of a history in one reply."""

MOST_AT_ONCE = 1000
"""Variables that one call sets, gets, watches or publishes."""

SET_BYTES = VALUE_BYTES + 1024
"""Bytes of the arguments of `set` and `set_many`: one value of the largest size, with its name."""

NAMES_BYTES = 1 << 18
"""Bytes of the arguments of calls that list names: `MOST_AT_ONCE` names of 255 bytes."""


class DataCalls:
    """Mutable: its parts, and what is still to be sent.

    Args:
        variables, semaphores, answers, watches, wanted: the state, loaded.
        others: more methods.
        lost: called for each connection that has ended.
        stop: carries out an emergency stop, given the connection and the time.
        full: returns sentences about limits that the server has reached.
        no_room: returns the reason why nothing can be kept, None while there is room for it.
    """

    def __init__(
        self,
        variables: Variables,
        semaphores: Semaphores,
        answers: Answers,
        watches: Watches,
        wanted: Wanted,
        *,
        others: Iterable[Method] = (),
        lost: Callable[[Caller], None] = lambda caller: None,
        stop: Callable[[str, int], None] | None = None,
        full: Callable[[], Iterable[str]] = lambda: (),
        no_room: Callable[[], str | None] = lambda: None,
    ) -> None:
        self._no_room = no_room
        self._variables = variables
        self._semaphores = semaphores
        self._answers = answers
        self._watches = watches
        self._wanted = wanted
        self._telling = Telling(variables, watches, self._notify)
        self._next_slice: int | None = None
        self._desk = CallDesk(
            DSERVER.name,
            (*self._methods(), *others),
            admit=self._admit,
            lost=self._end,
            stop=stop,
            full=full,
        )
        self._tell_lost = lost
        self._callers: dict[str, Caller] = {}
        self._opened: list[str] = []
        self._effects: list[Effect] = []
        self._alarm: int | None = None
        self._return_by: int | None = None
        self.listens = self._desk.listens

    def start(self, now_ns: int) -> Iterator[Effect]:
        """Nobody is connected yet: give those who were the time to come back."""
        self._watches.start(now_ns)
        if self._semaphores.holders_but(()):
            self._return_by = now_ns + RETURN_NS
            yield WakeAt(self._return_by)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Take what is for the desk: calls, signs of life, what could not be read, and the time."""
        if isinstance(message, Wake):
            self._wake(now_ns)
        yield from self._desk.handle(message, now_ns)
        if self._opened:
            self._greet()
        if self._effects:
            yield from self._flush()
        if self._telling.waiting:
            yield from self._tell(now_ns)

    def changed(self, names: Iterable[str], now_ns: int) -> Iterator[Effect]:
        """Send notices of variables that actuators have set."""
        for name in names:
            self._telling.changed(name)
        yield from self._tell(now_ns)

    def _methods(self) -> tuple[Method, ...]:
        once = self._once
        return (
            method("set", Set, once(self._set), largest=SET_BYTES),
            method("set_many", SetMany, once(self._set_many), largest=SET_BYTES),
            method("get", Get, self._get, right="read"),
            method("get_many", GetMany, self._get_many, right="read", largest=NAMES_BYTES),
            method("history", History, self._history, right="read"),
            method("set_history", SetHistory, once(self._set_history)),
            method("delete", Named, once(self._delete)),
            method("names", ListNames, self._names, right="read"),
            method("publish", Publish, self._publish, right="read", lasting=True, largest=NAMES_BYTES),
            method("create_semaphore", CreateSemaphore, once(self._create_semaphore)),
            method("wait", Wait, once(self._wait)),
            method("signal", Named, once(self._signal)),
            method("release", Named, once(self._release)),
            method("semaphore", Named, self._semaphore, right="read"),
            method("semaphores", ListNames, self._semaphore_names, right="read"),
            method("delete_semaphore", Named, once(self._delete_semaphore)),
            method("watch", Watch, self._watch, right="read", lasting=True, largest=NAMES_BYTES),
            method("unwatch", Watch, self._unwatch, right="read", lasting=True, largest=NAMES_BYTES),
        )

    def _once(self, handler: Handler) -> Handler:
        """A handler that gives the answer noted to a call that it has done before."""

        def handle(asked: Asked, arguments: Any, now_ns: int) -> object:
            connection, number = asked.caller.connection, asked.number
            done = self._answers.find(connection, number)
            if done is not None:
                return msgspec.Raw(done)
            try:
                self._expect_room()
                result = handler(asked, arguments, now_ns)
            except Refused:
                self._answers.settle(connection, number)
                raise
            if isinstance(result, Later):
                self._answers.pend(connection, number)
            else:
                self._answers.note(connection, number, _encode(result))
            return result

        return handle

    def _expect_room(self) -> None:
        """Check that what a call changes can be kept.

        Raises:
            Refused: "full".
        """
        if (why := self._no_room()) is not None:
            raise Refused("full", f"DServer keeps nothing new: {why}")

    # --- variables -----------------------------------------------------------------------------------

    def _set(self, asked: Asked, arguments: Set, now_ns: int) -> None:
        name = named(arguments.name)
        self._variables.set((prepared(name, arguments.value),), now_ns)
        self._telling.changed(name)

    def _set_many(self, asked: Asked, arguments: SetMany, now_ns: int) -> None:
        values = several(arguments)
        self._variables.set(values, now_ns)
        for value in values:
            self._telling.changed(value.name)

    def _get(self, asked: Asked, arguments: Get, now_ns: int) -> msgspec.Raw:
        try:
            return msgspec.Raw(self._variables.value(arguments.name, arguments.back).data)
        except Refused:
            if not self._variables.has(arguments.name) and self._semaphores.has(arguments.name):
                raise Refused("unknown", f"DServer: `{arguments.name}` is a semaphore") from None
            raise

    def _get_many(self, asked: Asked, arguments: GetMany, now_ns: int) -> dict[str, msgspec.Raw]:
        _few(len(arguments.names))
        missing = [name for name in arguments.names if not self._variables.has(name)]
        if missing:
            raise unknown("`, `".join(missing[:10]))
        found = {name: self._variables.value(name) for name in arguments.names}
        _fit(found.values(), "fewer variables")
        return {name: msgspec.Raw(dating.data) for name, dating in found.items()}

    def _history(self, asked: Asked, arguments: History, now_ns: int) -> tuple[Dated, ...]:
        limit = arguments.limit
        if not 1 <= limit <= MOST_VALUES or arguments.back > 0:
            wrong = f"{limit} values of a history, from value {arguments.back} on"
            expected = f"1 to {MOST_VALUES}, from value 0 or an older one on"
            raise Refused("arguments", f"DServer: {wrong}; expected {expected}")
        found = tuple(islice(self._variables.history(arguments.name, arguments.back), limit))
        _fit(found, "fewer values, or single ones by `get`")
        return tuple(_dated(dating) for dating in found)

    def _set_history(self, asked: Asked, arguments: SetHistory, now_ns: int) -> None:
        self._variables.set_history(named(arguments.name), arguments.length)

    def _delete(self, asked: Asked, arguments: Named, now_ns: int) -> bool:
        deleted = self._variables.delete(arguments.name)
        if deleted:
            self._telling.changed(arguments.name)
        return deleted

    def _names(self, asked: Asked, arguments: ListNames, now_ns: int) -> tuple[str, ...]:
        return _page(self._variables.names, arguments)

    def _publish(self, asked: Asked, arguments: Publish, now_ns: int) -> None:
        _few(len(arguments.names))
        names = dict.fromkeys(named(name) for name in arguments.names)
        self._variables.expect_frames_with(names)
        self._variables.show(self._wanted.ask(asked.caller.connection, names))

    # --- semaphores ----------------------------------------------------------------------------------

    def _create_semaphore(self, asked: Asked, arguments: CreateSemaphore, now_ns: int) -> bool:
        return self._semaphores.create(named(arguments.name), arguments.value)

    def _wait(self, asked: Asked, arguments: Wait, now_ns: int) -> Later | None:
        name, hold = arguments.name, arguments.hold
        waiter = self._semaphores.wait(asked, name, arguments.wait_ns, now_ns, hold=hold)
        if waiter is None:
            return None
        self._wake_by(waiter.until_ns)
        return LATER

    def _signal(self, asked: Asked, arguments: Named, now_ns: int) -> None:
        self._grant(self._semaphores.signal(arguments.name, asked.caller.connection))

    def _release(self, asked: Asked, arguments: Named, now_ns: int) -> None:
        self._grant(self._semaphores.release(arguments.name, asked.caller.connection))

    def _semaphore(self, asked: Asked, arguments: Named, now_ns: int) -> SemaphoreState:
        return self._semaphores.state(arguments.name)

    def _semaphore_names(self, asked: Asked, arguments: ListNames, now_ns: int) -> tuple[str, ...]:
        return _page(self._semaphores.names, arguments)

    def _delete_semaphore(self, asked: Asked, arguments: Named, now_ns: int) -> bool:
        deleted, waited = self._semaphores.delete(arguments.name)
        for waiter in waited:
            self._refuse(waiter, Refused("deleted", f"DServer: `{arguments.name}` was deleted"))
        return deleted

    def _grant(self, asked: Asked | None) -> None:
        """Answer a call that waited for a semaphore and has got it."""
        if asked is not None:
            self._answers.note(asked.caller.connection, asked.number, _NIL)
            self._effects += self._desk.answer(asked, None)

    def _refuse(self, asked: Asked, refused: Refused) -> None:
        self._answers.settle(asked.caller.connection, asked.number)
        self._effects += self._desk.refuse(asked, refused)

    # --- changes -------------------------------------------------------------------------------------

    def _watch(self, asked: Asked, arguments: Watch, now_ns: int) -> None:
        self._expect_room()
        _few(len(arguments.names) + len(arguments.prefixes))
        for one in (*arguments.names, *arguments.prefixes):
            named(one or "-")  # a prefix may be empty
        connection = asked.caller.connection
        self._watches.add(connection, arguments.names, arguments.prefixes)
        self._telling.greet(connection, arguments.names, arguments.prefixes)

    def _unwatch(self, asked: Asked, arguments: Watch, now_ns: int) -> None:
        _few(len(arguments.names) + len(arguments.prefixes))
        if arguments.names or arguments.prefixes:
            self._watches.remove(asked.caller.connection, arguments.names, arguments.prefixes)
        else:
            self._watches.forget(asked.caller.connection)

    def _notify(self, connection: str, name: str, body: msgspec.Raw) -> Iterator[Effect]:
        caller = self._callers.get(connection)
        if caller is not None:
            yield from self._desk.notify(caller, name, body)

    def _tell(self, now_ns: int) -> Iterator[Effect]:
        """Send one slice of notices, and ask for a wake if more are due."""
        yield from self._telling.slice()
        if not self._telling.waiting:
            self._next_slice = None
        elif self._next_slice is None or now_ns >= self._next_slice:
            self._next_slice = now_ns + PAUSE_NS
            yield WakeAt(self._next_slice)

    # --- connections and time ------------------------------------------------------------------------

    def _admit(self, caller: Caller) -> None:
        self._callers[caller.connection] = caller
        self._opened.append(caller.connection)

    def _greet(self) -> None:
        """Restore the watches of connections that have opened, and send them the present values."""
        opened, self._opened = self._opened, []
        for connection in opened:
            self._watches.opened(connection)
            self._telling.greet(connection, *self._watches.of(connection))

    def _end(self, caller: Caller, now_ns: int) -> Iterable[Effect]:
        connection = caller.connection
        self._callers.pop(connection, None)
        self._watches.lost(connection, now_ns)
        self._telling.lost(connection)
        self._variables.hide(self._wanted.lost(connection))
        self._give_up(connection)
        self._tell_lost(caller)
        return ()

    def _give_up(self, connection: str) -> None:
        """Free a connection's places in queues, and the semaphores that it holds, for others."""
        held, granted = self._semaphores.drop(connection)
        for number in held:
            self._answers.undo(connection, number)
        for asked in granted:
            self._grant(asked)

    def _wake(self, now_ns: int) -> None:
        self._watches.expire(now_ns)
        if self._return_by is not None and now_ns >= self._return_by:
            self._return_by = None
            for connection in self._semaphores.holders_but(self._callers):
                self._give_up(connection)
        if self._alarm is not None and now_ns >= self._alarm:
            self._alarm = None
            for waiter in self._semaphores.expire(now_ns):
                self._refuse(waiter.asked, timed_out(waiter.name))
            self._wake_by(self._semaphores.wake_at)

    def _wake_by(self, due_ns: int | None) -> None:
        if due_ns is not None and (self._alarm is None or due_ns < self._alarm):
            self._alarm = due_ns
            self._effects.append(WakeAt(due_ns))

    def _flush(self) -> Iterator[Effect]:
        effects, self._effects = self._effects, []
        yield from effects


_encode = msgspec.msgpack.Encoder().encode
_NIL = _encode(None)


def _dated(dating: Dating) -> Dated:
    return Dated(t_ns=dating.t_ns, value=msgspec.Raw(dating.data))


def _fit(datings: Iterable[Dating], instead: str) -> None:
    size = sum(len(dating.data) + 16 for dating in datings)
    if size > REPLY_BYTES:
        text = f"DServer: {size} bytes of values are too many for one reply; ask for {instead}"
        raise Refused("size", text)


def several(arguments: SetMany) -> list[Prepared]:
    """Return the values, checked, that a call of `set_many` sets.

    Raises:
        Refused: "arguments" or "size".
    """
    _few(arguments.count)
    try:
        values = arguments.read()
    except (msgspec.DecodeError, UnicodeDecodeError) as problem:
        raise Refused("arguments", f"DServer.set_many: {problem} of the values") from None
    readable = len(memoryview(arguments.values)) <= READ_BYTES
    return [prepared(named(name), value, readable=readable) for name, value in values.items()]


def _few(count: int) -> None:
    if count > MOST_AT_ONCE:
        raise Refused("size", f"DServer: {count} names in one call; expected at most {MOST_AT_ONCE}")


def _page(names: Names, wanted: ListNames) -> tuple[str, ...]:
    """Return the names that a call asks for.

    Raises:
        Refused: "arguments".
    """
    if not 1 <= wanted.limit <= MOST_NAMES:
        raise Refused("arguments", f"DServer: a limit of {wanted.limit} names; expected 1 to {MOST_NAMES}")
    return names.page(wanted.prefix, wanted.after, wanted.limit)
