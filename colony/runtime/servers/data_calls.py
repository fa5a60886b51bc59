"""Handling of the calls of DServer, which the functions of `library/data.py` make (thesis section 4.6.1).

Variables, semaphores, watches and answers put their changes into one journal, which the server commits before
any effect leaves.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import msgspec

from colony.ir.servers import DSERVER
from colony.runtime.library.data import (
    Change,
    Publish,
    TimedValue,
    Watch,
)
from colony.runtime.protocol.calls import CallDispatcher, CallId, Handler, Later, Method, RefusedError, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.messages import Effect, Message, Wake, WakeAt, WakeSchedule
from colony.runtime.protocol.topics import user_of
from colony.runtime.servers.call_answers import CallAnswers, ResourceLimit
from colony.runtime.servers.data_methods import MAX_NAMES_BYTES, DataMethods, check_count
from colony.runtime.servers.frame_content import FrameSubscriptions
from colony.runtime.servers.outside_control import Answer
from colony.runtime.servers.semaphores import Semaphores
from colony.runtime.servers.variables import MAX_VARIABLES, StoredValue, Variables, validate_name
from colony.runtime.store.store import Journal, Key

# --- watching ------------------------------------------------------------------------------------------
#
# Watches: the connections that get notices about changes of DServer's variables.
#
# The watches of a lost connection are kept for a while, even across a restart of the server. A reopened
# connection keeps its watches and gets the current values, as it may have missed changes.


MAX_WATCHED_PER_CONNECTION = 2_000
"""Maximum number of names and prefixes that one connection may watch."""

MAX_PREFIXES_PER_CONNECTION = 50
"""Maximum number of prefixes that one connection may watch."""

MAX_WATCHED_NAMES = 20_000
"""Maximum number of names that all connections together may watch."""

MAX_WATCHED_PREFIXES = 1_000
"""Maximum number of prefixes that all connections together may watch."""

USER_LIMIT_DIVISOR = 2
"""One user may use 1/`USER_LIMIT_DIVISOR` of each limit for all connections together."""

LOST_WATCHES_NS = 60_000_000_000
"""Nanoseconds for which the watches of a lost connection are kept."""


@dataclass(frozen=False, slots=True, kw_only=True)
class _Watch:
    names: dict[str, None] = field(default_factory=dict)
    prefixes: dict[str, None] = field(default_factory=dict)
    expires_ns: int | None = None  # None while the connection is open


class Watches:
    """The watches of all connections. Mutable; changes are written to the journal."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._watches: dict[str, _Watch] = {}
        self._by_name: dict[str, dict[str, None]] = {}
        self._by_prefix: dict[str, dict[str, None]] = {}
        self._lengths: Counter[int] = Counter()  # lengths of the prefixes
        self._names = self._prefixes = 0
        self._name_limit = ResourceLimit("names watched", MAX_WATCHED_NAMES)
        self._prefix_limit = ResourceLimit("prefixes watched", MAX_WATCHED_PREFIXES)

    @property
    def limit_messages(self) -> tuple[str, ...]:
        """User-readable messages about the limits reached since the server started."""
        return (
            *self._name_limit.limit_messages(self._names),
            *self._prefix_limit.limit_messages(self._prefixes),
        )

    def watchers(self, name: str) -> Collection[str]:
        """Return the connections that watch a variable, each once."""
        connections = self._by_name.get(name, _NO_CONNECTIONS)
        for length in self._lengths:
            connections = connections | self._by_prefix.get(name[:length], _NO_CONNECTIONS)
        return connections

    def watched_by(self, connection: str) -> tuple[Iterable[str], Iterable[str]]:
        """Return the names and the prefixes that a connection watches."""
        watch = self._watches.get(connection)
        return ((), ()) if watch is None else (watch.names, watch.prefixes)

    def add(self, connection: str, names: Iterable[str], prefixes: Iterable[str]) -> None:
        """Add names and prefixes to the watches of a connection.

        Raises:
            RefusedError: "full".
        """
        watch = self._watches.get(connection, _Watch())
        names = [name for name in dict.fromkeys(names) if name not in watch.names]
        prefixes = [prefix for prefix in dict.fromkeys(prefixes) if prefix not in watch.prefixes]
        if len(watch.names) + len(names) + len(watch.prefixes) + len(prefixes) > MAX_WATCHED_PER_CONNECTION:
            raise RefusedError(
                "full",
                f"DServer: a connection may watch at most {MAX_WATCHED_PER_CONNECTION} names and prefixes",
            )
        if len(watch.prefixes) + len(prefixes) > MAX_PREFIXES_PER_CONNECTION:
            raise RefusedError(
                "full", f"DServer: a connection may watch at most {MAX_PREFIXES_PER_CONNECTION} prefixes"
            )
        user_watches = [w for c, w in self._watches.items() if user_of(c) == user_of(connection)]
        if sum(len(w.names) for w in user_watches) + len(names) > MAX_WATCHED_NAMES // USER_LIMIT_DIVISOR:
            raise RefusedError(
                "full", f"DServer: a user may watch at most {MAX_WATCHED_NAMES // USER_LIMIT_DIVISOR} names"
            )
        if (
            sum(len(w.prefixes) for w in user_watches) + len(prefixes)
            > MAX_WATCHED_PREFIXES // USER_LIMIT_DIVISOR
        ):
            raise RefusedError(
                "full",
                f"DServer: a user may watch at most {MAX_WATCHED_PREFIXES // USER_LIMIT_DIVISOR} prefixes",
            )
        if not self._name_limit.allows(self._names + len(names)):
            raise RefusedError("full", f"DServer: connections watch {MAX_WATCHED_NAMES} names already")
        if not self._prefix_limit.allows(self._prefixes + len(prefixes)):
            raise RefusedError("full", f"DServer: connections watch {MAX_WATCHED_PREFIXES} prefixes already")
        self._journal.mark_ack_pending()
        self._watches[connection] = watch
        watch.names |= dict.fromkeys(names)
        watch.prefixes |= dict.fromkeys(prefixes)
        self._index(connection, names, prefixes)
        self._persist(connection, watch)

    def remove(self, connection: str, names: Iterable[str], prefixes: Iterable[str]) -> None:
        """Remove names and prefixes from the watches of a connection."""
        watch = self._watches.get(connection)
        if watch is None:
            return
        for name in dict.fromkeys(names):
            if name in watch.names:
                del watch.names[name]
                self._names -= 1
                _unindex(self._by_name, name, connection)
        for prefix in dict.fromkeys(prefixes):
            if prefix in watch.prefixes:
                del watch.prefixes[prefix]
                self._prefixes -= 1
                if _unindex(self._by_prefix, prefix, connection):
                    self._lengths -= Counter((len(prefix),))
        self._persist(connection, watch)

    def forget(self, connection: str) -> None:
        """Drop all watches of a connection."""
        watch = self._watches.get(connection)
        if watch is not None:
            self.remove(connection, [*watch.names], [*watch.prefixes])

    def on_reopened(self, connection: str) -> None:
        """Cancel the timeout of the watches of a connection that was reopened."""
        watch = self._watches.get(connection)
        if watch is not None:
            watch.expires_ns = None

    def on_lost(self, connection: str, now_ns: int) -> None:
        """Start the timeout of the watches of a lost connection; it may reconnect."""
        watch = self._watches.get(connection)
        if watch is not None:
            watch.expires_ns = now_ns + LOST_WATCHES_NS

    def expire(self, now_ns: int) -> None:
        """Drop the watches of connections that did not reconnect."""
        expired = [c for c, w in self._watches.items() if w.expires_ns is not None and now_ns >= w.expires_ns]
        for connection in expired:
            self.forget(connection)

    def start(self, now_ns: int) -> None:
        """Start the timeouts of all loaded watches, as no connection is open yet."""
        for connection in self._watches:
            self.on_lost(connection, now_ns)

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Load the entries of kind "watch" from a store."""
        for key, data in entries.items():
            if key.kind == "watch":
                names, prefixes = _watched.decode(data)
                watch = _Watch(names=dict.fromkeys(names), prefixes=dict.fromkeys(prefixes))
                self._watches[key.name] = watch
                self._index(key.name, names, prefixes)

    def _index(self, connection: str, names: Sequence[str], prefixes: Sequence[str]) -> None:
        self._names += len(names)
        self._prefixes += len(prefixes)
        self._lengths.update(len(prefix) for prefix in prefixes if prefix not in self._by_prefix)
        for table, new in ((self._by_name, names), (self._by_prefix, prefixes)):
            for key in new:
                table.setdefault(key, {})[connection] = None

    def _persist(self, connection: str, watch: _Watch) -> None:
        if watch.names or watch.prefixes:
            self._journal.put(Key("watch", connection), _watching_encode(([*watch.names], [*watch.prefixes])))
        else:
            del self._watches[connection]
            self._journal.drop(Key("watch", connection))


def _unindex(table: dict[str, dict[str, None]], key: str, connection: str) -> bool:
    """Remove a connection from the entry of a key; return True if it was the last one."""
    del table[key][connection]
    if table[key]:
        return False
    del table[key]
    return True


_NO_CONNECTIONS: dict[str, None] = {}
_watching_encode = msgspec.msgpack.Encoder().encode
_watched = msgspec.msgpack.Decoder(tuple[tuple[str, ...], tuple[str, ...]])


# --- notices -------------------------------------------------------------------------------------------
#
# Notices to the connections that watch variables, sent in slices.
#
# A few notices are sent immediately. A connection that starts to watch thousands of variables, or a large
# value with hundreds of watchers, must not delay everything else. So a slice is limited in notices and
# bytes, and the next slice is sent later. A variable that changes again before its notice is sent gets a
# single one.


SLICE_NOTICES = 250
"""Maximum number of notices in one slice."""

SLICE_BYTES = 2 << 20
"""Bytes of notices after which a slice ends; its last notice may exceed the limit."""

SLICE_INTERVAL_NS = 10_000_000
"""Nanoseconds between two slices."""

Notify = Callable[[str, str, msgspec.Raw], Iterable[Effect]]
"""Function from a connection, a variable and a body to the effects that send the notice."""


class NoticeQueue:
    """The notices to be sent. Mutable.

    Args:
        variables: the variables that the notices are about.
        watches: the watches of all connections.
        notify: returns the effects that send a notice; none if the connection is gone.
    """

    def __init__(self, variables: Variables, watches: Watches, notify: Notify) -> None:
        self._variables = variables
        self._watches = watches
        self._notify = notify
        self._changed: dict[str, None] = {}
        self._initial: dict[str, tuple[dict[str, None], dict[str, None]]] = {}
        self._current: Iterator[_Notice] | None = None

    @property
    def pending(self) -> bool:
        """True if there are notices to be sent."""
        return bool(self._changed or self._initial) or self._current is not None

    def mark_changed(self, name: str) -> None:
        """Queue notices about a variable that was set or deleted.

        At most `MAX_VARIABLES` variables exist at a time. If twice as many names are queued, at least half of
        them were deleted again, and further notices are dropped.
        """
        if len(self._changed) < 2 * MAX_VARIABLES and self._watches.watchers(name):
            self._changed[name] = None

    def queue_current_values(self, connection: str, names: Iterable[str], prefixes: Iterable[str]) -> None:
        """Queue notices of the current values, for a connection that starts or resumes watching these."""
        queued_names, queued_prefixes = self._initial.setdefault(connection, ({}, {}))
        queued_names.update(dict.fromkeys(names))
        queued_prefixes.update(dict.fromkeys(prefixes))

    def on_lost(self, connection: str) -> None:
        """Drop the initial notices of a connection that has ended."""
        self._initial.pop(connection, None)

    def slice(self) -> Iterator[Effect]:
        """Yield the effects that send one slice of notices."""
        notices_left, bytes_left = SLICE_NOTICES, SLICE_BYTES
        while notices_left > 0 and bytes_left > 0:
            self._current = self._current or self._next()
            if self._current is None:
                return
            notice = next(self._current, None)
            if notice is None:
                self._current = None
                continue
            notices_left -= 1
            bytes_left -= len(memoryview(notice.body))
            yield from self._notify(*notice)

    def _next(self) -> Iterator[_Notice] | None:
        if self._changed:
            name = next(iter(self._changed))
            del self._changed[name]
            return self._change_notices(name)
        if self._initial:
            connection, (names, prefixes) = next(iter(self._initial.items()))
            del self._initial[connection]
            return self._initial_notices(connection, names, prefixes)
        return None

    def _change_notices(self, name: str) -> Iterator[_Notice]:
        """Yield the notices about one variable, to all connections that watch it."""
        current = self._variables.current(name)
        if current is not None or not self._variables.has(name):
            body = _body(name, current)
            for connection in tuple(self._watches.watchers(name)):
                yield _Notice(connection, name, body)

    def _initial_notices(
        self, connection: str, names: Iterable[str], prefixes: Iterable[str]
    ) -> Iterator[_Notice]:
        """Yield notices of the current values of all variables that a connection watches."""
        for name in sorted({*names, *self._variables.names.with_prefixes(prefixes)}):
            current = self._variables.current(name)
            if current is not None:
                yield _Notice(connection, name, _body(name, current))


class _Notice(NamedTuple):
    connection: str
    name: str
    body: msgspec.Raw


def _body(name: str, current: StoredValue | None) -> msgspec.Raw:
    timed = None if current is None else TimedValue(t_ns=current.t_ns, value=msgspec.Raw(current.data))
    return msgspec.Raw(_notices_encode(Change(name=name, present=timed)))


_notices_encode = msgspec.msgpack.Encoder().encode


# --- data calls ----------------------------------------------------------------------------------------


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
