"""Telling the connections that watch variables what became of these, a slice at a time.

What changed is told at once, as long as that is little. A connection that begins to watch thousands of
variables, or one large value that hundreds watch, must not hold up everybody else; so the notices of one
moment are bounded, and the rest go later. A variable that changes again before its turn is told once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import msgspec

from colony.runtime.library.data import Change, Dated
from colony.runtime.messages import Effect
from colony.runtime.servers.variables import MOST, Dating, Variables
from colony.runtime.servers.watching import Watches

SLICE = 250
"""Notices that are sent in one moment."""

SLICE_BYTES = 2 << 20
"""Bytes of values that are sent in the notices of one moment, and one value more."""

PAUSE_NS = 10_000_000
"""Time from one slice to the next."""

Notify = Callable[[str, str, msgspec.Raw], Iterable[Effect]]
"""Gives the notice to a connection about a variable."""


class Telling:
    """Mutable: what is still to be told.

    Args:
        variables: what there is to tell of.
        watches: who is told of it.
        notify: gives the notice to a connection, or nothing if it is not there.
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
        """Whether there is something to be told."""
        return bool(self._changed or self._greeted) or self._telling is not None

    def changed(self, name: str) -> None:
        """A variable was set or deleted."""
        if len(self._changed) < 2 * MOST and self._watches.watchers(name):
            self._changed[name] = None

    def greet(self, connection: str, names: Iterable[str], prefixes: Iterable[str]) -> None:
        """A connection watches these from now on, or again: it is to be told how they are."""
        known_names, known_prefixes = self._greeted.setdefault(connection, ({}, {}))
        known_names.update(dict.fromkeys(names))
        known_prefixes.update(dict.fromkeys(prefixes))

    def lost(self, connection: str) -> None:
        """A connection is not there any more."""
        self._greeted.pop(connection, None)

    def slice(self) -> Iterator[Effect]:
        """The notices of one moment."""
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
        """A variable for everybody who watches it."""
        present = self._variables.present(name)
        if present is not None or not self._variables.has(name):
            body = _body(name, present)
            for connection in tuple(self._watches.watchers(name)):
                yield _Notice(connection, name, body)

    def _greeting(self, connection: str, names: Iterable[str], prefixes: Iterable[str]) -> Iterator[_Notice]:
        """The present values of all that a connection watches."""
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
