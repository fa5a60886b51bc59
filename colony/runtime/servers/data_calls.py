"""The calls of DServer, made by the functions of `library/data.py` (thesis section 4.6.1).

Each part (variables, semaphores, watches, answers) puts its changes into one journal, which the server
commits before any effect leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import msgspec

from colony.runtime.library.data import (
    Publish,
    Watch,
)
from colony.runtime.protocol.calls import Asked, CallDesk, Handler, Later, Method, RefusedError, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.fields import DSERVER
from colony.runtime.protocol.messages import Effect, Message, Wake, WakeAt
from colony.runtime.servers.data_methods import NAMES_BYTES, DataMethods, few
from colony.runtime.servers.naming import named
from colony.runtime.servers.once import CallAnswers
from colony.runtime.servers.semaphores import Semaphores
from colony.runtime.servers.showing import Wanted
from colony.runtime.servers.telling import PAUSE_NS, Telling
from colony.runtime.servers.variables import (
    Variables,
)
from colony.runtime.servers.watching import Watches

RETURN_NS = 2_000_000_000
"""Nanoseconds after a restart in which the holds of a connection are kept for it to reconnect.

If the time were shorter, a client about to reconnect might find that another one has its semaphore too.
"""


class DataCalls:
    """The calls of DServer. Mutable: its parts, and the notices and answers that are due.

    Args:
        variables: the variables, loaded.
        semaphores: the semaphores, loaded.
        answers: the answers to calls, loaded.
        watches: the watches of connections, loaded.
        wanted: the variables asked for in frames, loaded.
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
        answers: CallAnswers,
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
        self._data = DataMethods(variables, semaphores, self._telling.changed)
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
        self._alarm: int | None = None
        self._return_by: int | None = None
        self.listens = self._desk.listens

    def start(self, now_ns: int) -> Iterator[Effect]:
        """Start without connections, and give earlier ones the time to reconnect."""
        self._watches.start(now_ns)
        if self._semaphores.holders_but(()):
            self._return_by = now_ns + RETURN_NS
            yield WakeAt(self._return_by)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Handle calls, signs of life, malformed calls, and wakes."""
        if isinstance(message, Wake):
            self._wake(now_ns)
        yield from self._desk.handle(message, now_ns)
        if self._opened:
            self._greet()
        yield from self._settle(now_ns)
        if self._telling.waiting:
            yield from self._tell(now_ns)

    def changed(self, names: Iterable[str], now_ns: int) -> Iterator[Effect]:
        """Send notices about variables that actuators have set."""
        for name in names:
            self._telling.changed(name)
        yield from self._tell(now_ns)

    def _methods(self) -> tuple[Method, ...]:
        return (
            *(
                m if m.right == "read" else m._replace(handler=self._once(m.handler))
                for m in self._data.methods
            ),
            method("publish", Publish, self._publish, right="read", lasting=True, largest=NAMES_BYTES),
            method("watch", Watch, self._watch, right="read", lasting=True, largest=NAMES_BYTES),
            method("unwatch", Watch, self._unwatch, right="read", lasting=True, largest=NAMES_BYTES),
        )

    def _once(self, handler: Handler) -> Handler:
        """Return a handler that repeats the noted answer to a call that was done before."""

        def handle(asked: Asked, arguments: Any, now_ns: int) -> object:
            connection, number = asked.caller.connection, asked.number
            done = self._answers.find(connection, number)
            if done is not None:
                return msgspec.Raw(done)
            try:
                self._expect_room()
                result = handler(asked, arguments, now_ns)
            except RefusedError:
                self._answers.settle(connection, number)
                raise
            if isinstance(result, Later):
                self._answers.pend(connection, number)
            else:
                self._answers.note(connection, number, _encode(result))
            return result

        return handle

    def _expect_room(self) -> None:
        """Check that the changes of a call can be kept.

        Raises:
            RefusedError: "full".
        """
        if (why := self._no_room()) is not None:
            raise RefusedError("full", f"DServer keeps nothing new: {why}")

    # --- variables -----------------------------------------------------------------------------------

    def _publish(self, asked: Asked, arguments: Publish, now_ns: int) -> None:
        few(len(arguments.names))
        names = dict.fromkeys(named(name) for name in arguments.names)
        self._variables.expect_frames_with(names)
        self._variables.show(self._wanted.ask(asked.caller.connection, names))

    # --- changes -------------------------------------------------------------------------------------

    def _watch(self, asked: Asked, arguments: Watch, now_ns: int) -> None:
        self._expect_room()
        few(len(arguments.names) + len(arguments.prefixes))
        for one in (*arguments.names, *arguments.prefixes):
            named(one or "-")  # a prefix may be empty
        connection = asked.caller.connection
        self._watches.add(connection, arguments.names, arguments.prefixes)
        self._telling.greet(connection, arguments.names, arguments.prefixes)

    def _unwatch(self, asked: Asked, arguments: Watch, now_ns: int) -> None:
        few(len(arguments.names) + len(arguments.prefixes))
        if arguments.names or arguments.prefixes:
            self._watches.remove(asked.caller.connection, arguments.names, arguments.prefixes)
        else:
            self._watches.forget(asked.caller.connection)

    def _notify(self, connection: str, name: str, body: msgspec.Raw) -> Iterator[Effect]:
        caller = self._callers.get(connection)
        if caller is not None:
            yield from self._desk.notify(caller, name, body)

    def _tell(self, now_ns: int) -> Iterator[Effect]:
        """Send one slice of notices, and schedule a wake if more are due."""
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
        """Release a connection's places in queues, and the semaphores that it holds."""
        for number in self._data.drop(connection):
            self._answers.undo(connection, number)

    def _wake(self, now_ns: int) -> None:
        self._watches.expire(now_ns)
        if self._return_by is not None and now_ns >= self._return_by:
            self._return_by = None
            for connection in self._semaphores.holders_but(self._callers):
                self._give_up(connection)
        self._data.expire(now_ns)

    def _settle(self, now_ns: int) -> Iterator[Effect]:
        """Answer the calls that have waited, and schedule a wake for those that still wait."""
        answers, self._data.answers = self._data.answers, []
        for asked, result in answers:
            if isinstance(result, RefusedError):
                self._answers.settle(asked.caller.connection, asked.number)
            else:
                self._answers.note(asked.caller.connection, asked.number, _NIL)
        yield from self._desk.settle(answers)
        due = self._data.wake_at
        if due is None or due == self._alarm:
            return
        if self._alarm is None or due < self._alarm or now_ns >= self._alarm:
            self._alarm = due
            yield WakeAt(due)


_encode = msgspec.msgpack.Encoder().encode
_NIL = _encode(None)
