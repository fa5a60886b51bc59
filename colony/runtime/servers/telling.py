"""Notices to the connections that watch variables, sent in slices.

A few notices go out immediately. A connection that begins to watch thousands of variables, or a large value
that hundreds of connections watch, must not delay all others: a slice has a limited number of notices and
bytes, and the next slice goes out later. A variable that changes again before its turn gets one notice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import msgspec

from colony.runtime.library.data import Change, Dated
from colony.runtime.protocol.messages import Effect
from colony.runtime.servers.variables import MOST, Dating, Variables
from colony.runtime.servers.watching import Watches

SLICE = 250
"""Largest number of notices in one slice."""

SLICE_BYTES = 2 << 20
"""Bytes of notices after which a slice ends; its last notice may go beyond."""

PAUSE_NS = 10_000_000
"""Nanoseconds between two slices."""

Notify = Callable[[str, str, msgspec.Raw], Iterable[Effect]]
"""A function that returns the effects that send a connection a notice about a variable."""


class Telling:
    """The notices that are due. Mutable: these.

    Args:
        variables: the variables that the notices are about.
        watches: the connections that watch them.
        notify: returns the effects that send a notice, none if the connection is gone.
    """

    def __init__(self, variables: Variables, watches: Watches, notify: Notify) -> None:
        self._variables = variables
        self._watches = watches
        self._notify = notify
        self._changed: dict[str, None] = {}
        self._greeted: dict[str, tuple[dict[str, None], dict[str, None]]] = {}
        self._telling: Iterator[_Notice] | None = None

    @property
    def waiting(self) -> bool:
        """True if notices are due."""
        return bool(self._changed or self._greeted) or self._telling is not None

    def changed(self, name: str) -> None:
        """Note that a variable was set or deleted.

        At most `MOST` variables exist at a time. Beyond twice as many names, the rest were deleted before
        their turn came, and notices are dropped.
        """
        if len(self._changed) < 2 * MOST and self._watches.watchers(name):
            self._changed[name] = None

    def greet(self, connection: str, names: Iterable[str], prefixes: Iterable[str]) -> None:
        """Note that a connection starts or resumes watching these: it gets their present values."""
        known_names, known_prefixes = self._greeted.setdefault(connection, ({}, {}))
        known_names.update(dict.fromkeys(names))
        known_prefixes.update(dict.fromkeys(prefixes))

    def lost(self, connection: str) -> None:
        """Drop the initial notices of a connection that has ended."""
        self._greeted.pop(connection, None)

    def slice(self) -> Iterator[Effect]:
        """Yield the effects that send one slice of notices."""
        left, room = SLICE, SLICE_BYTES
        while left > 0 and room > 0:
            self._telling = self._telling or self._next()
            if self._telling is None:
                return
            notice = next(self._telling, None)
            if notice is None:
                self._telling = None
                continue
            left -= 1
            room -= len(memoryview(notice.body))
            yield from self._notify(*notice)

    def _next(self) -> Iterator[_Notice] | None:
        if self._changed:
            name = next(iter(self._changed))
            del self._changed[name]
            return self._news(name)
        if self._greeted:
            connection, (names, prefixes) = next(iter(self._greeted.items()))
            del self._greeted[connection]
            return self._greeting(connection, names, prefixes)
        return None

    def _news(self, name: str) -> Iterator[_Notice]:
        """Yield the notices about one variable, to all connections that watch it."""
        present = self._variables.present(name)
        if present is not None or not self._variables.has(name):
            body = _body(name, present)
            for connection in tuple(self._watches.watchers(name)):
                yield _Notice(connection, name, body)

    def _greeting(self, connection: str, names: Iterable[str], prefixes: Iterable[str]) -> Iterator[_Notice]:
        """Yield the notices of the present values of all variables that one connection watches."""
        for name in sorted({*names, *self._variables.names.beginning(prefixes)}):
            present = self._variables.present(name)
            if present is not None:
                yield _Notice(connection, name, _body(name, present))


class _Notice(NamedTuple):
    connection: str
    name: str
    body: msgspec.Raw


def _body(name: str, present: Dating | None) -> msgspec.Raw:
    dated = None if present is None else Dated(t_ns=present.t_ns, value=msgspec.Raw(present.data))
    return msgspec.Raw(_encode(Change(name=name, present=dated)))


_encode = msgspec.msgpack.Encoder().encode
