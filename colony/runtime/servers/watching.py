"""Watches: the connections that get notices about changes of DServer's variables.

The watches of a lost connection are kept for a while, even across a restart of the server. A reopened
connection keeps its watches and gets the current values, as it may have missed changes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import msgspec

from colony.runtime.protocol.calls import RefusedError
from colony.runtime.protocol.topics import user_of
from colony.runtime.servers.bounds import Bound
from colony.runtime.store.store import Journal, Key

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
        self._name_limit = Bound("names watched", MAX_WATCHED_NAMES)
        self._prefix_limit = Bound("prefixes watched", MAX_WATCHED_PREFIXES)

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
            self._journal.put(Key("watch", connection), _encode(([*watch.names], [*watch.prefixes])))
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
_encode = msgspec.msgpack.Encoder().encode
_watched = msgspec.msgpack.Decoder(tuple[tuple[str, ...], tuple[str, ...]])
