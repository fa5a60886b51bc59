"""Notices to the connections that watch variables, sent in slices.

A few notices are sent immediately. A connection that starts to watch thousands of variables, or a large value
with hundreds of watchers, must not delay everything else. So a slice is limited in notices and bytes, and the
next slice is sent later. A variable that changes again before its notice is sent gets a single one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import msgspec

from colony.runtime.library.data import Change, TimedValue
from colony.runtime.protocol.messages import Effect
from colony.runtime.servers.variables import MAX_VARIABLES, StoredValue, Variables
from colony.runtime.servers.watching import Watches

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
    return msgspec.Raw(_encode(Change(name=name, present=timed)))


_encode = msgspec.msgpack.Encoder().encode
