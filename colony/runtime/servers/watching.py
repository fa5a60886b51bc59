"""Who is to be told when which of DServer's variables change.

What a connection watches is kept for a while after it was lost, and over the death of the server: the
connection that is opened again goes on with it, and is told the present values, for it may have missed some.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import msgspec

from colony.runtime.calls import Refused
from colony.runtime.store import Journal, Key

MOST = 10_000
"""How many names and prefixes one connection may watch."""

KEPT_NS = 60_000_000_000
"""For how long it is kept what a lost connection watched."""


@dataclass(frozen=False, slots=True, kw_only=True)
class _Watch:
    names: dict[str, None] = field(default_factory=dict)
    prefixes: dict[str, None] = field(default_factory=dict)
    until_ns: int | None = None  # where the connection is lost


class Watches:
    """Mutable: what each connection watches. Goes into the journal as it changes."""

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._watches: dict[str, _Watch] = {}
        self._by_name: dict[str, dict[str, None]] = {}
        self._by_prefix: dict[str, dict[str, None]] = {}

    def watchers(self, name: str) -> Iterable[str]:
        """The connections that watch a variable, each once."""
        found = self._by_name.get(name, _NOBODY)
        for prefix, connections in self._by_prefix.items():
            if name.startswith(prefix):
                found = found | connections
        return found

    def of(self, connection: str, names: Callable[[], Iterable[str]]) -> list[str]:
        """Those of all variables that a connection watches; `names` gives all."""
        watch = self._watches.get(connection)
        if watch is None:
            return []
        prefixes = tuple(watch.prefixes)
        return [name for name in names() if name in watch.names or name.startswith(prefixes)]

    def add(self, connection: str, names: Iterable[str], prefixes: Iterable[str]) -> None:
        """Watch these too.

        Raises:
            Refused: "full".
        """
        watch = self._watches.get(connection, _Watch())
        names, prefixes = dict.fromkeys(names), dict.fromkeys(prefixes)
        if len(watch.names | names) + len(watch.prefixes | prefixes) > MOST:
            raise Refused("full", f"DServer: a connection watches at most {MOST} names and prefixes")
        self._watches[connection] = watch
        watch.names |= names
        watch.prefixes |= prefixes
        self._index(connection, names, prefixes)
        self._note(connection, watch)

    def remove(self, connection: str, names: Iterable[str], prefixes: Iterable[str]) -> None:
        """Watch these no more."""
        watch = self._watches.get(connection)
        if watch is None:
            return
        for table, own, gone in (
            (self._by_name, watch.names, names),
            (self._by_prefix, watch.prefixes, prefixes),
        ):
            for one in gone:
                if one in own:
                    del own[one], table[one][connection]
                    if not table[one]:
                        del table[one]
        self._note(connection, watch)

    def forget(self, connection: str) -> None:
        """Watch nothing any more."""
        watch = self._watches.get(connection)
        if watch is not None:
            self.remove(connection, [*watch.names], [*watch.prefixes])

    def opened(self, connection: str) -> None:
        """A connection is there (again)."""
        watch = self._watches.get(connection)
        if watch is not None:
            watch.until_ns = None

    def lost(self, connection: str, now_ns: int) -> None:
        """A connection was lost; it may come back."""
        watch = self._watches.get(connection)
        if watch is not None:
            watch.until_ns = now_ns + KEPT_NS

    def expire(self, now_ns: int) -> None:
        """Forget what those watched who did not come back."""
        late = [c for c, w in self._watches.items() if w.until_ns is not None and now_ns >= w.until_ns]
        for connection in late:
            self.forget(connection)

    def start(self, now_ns: int) -> None:
        """The server starts: nobody is there yet."""
        for connection in self._watches:
            self.lost(connection, now_ns)

    def load(self, entries: Mapping[Key, bytes]) -> None:
        """Take over what a store had of the kind "watch"."""
        for key, data in entries.items():
            if key.kind == "watch":
                names, prefixes = _watched.decode(data)
                watch = _Watch(names=dict.fromkeys(names), prefixes=dict.fromkeys(prefixes))
                self._watches[key.name] = watch
                self._index(key.name, names, prefixes)

    def _index(self, connection: str, names: Iterable[str], prefixes: Iterable[str]) -> None:
        for table, new in ((self._by_name, names), (self._by_prefix, prefixes)):
            for one in new:
                table.setdefault(one, {})[connection] = None

    def _note(self, connection: str, watch: _Watch) -> None:
        if watch.names or watch.prefixes:
            self._journal.put(Key("watch", connection), _encode(([*watch.names], [*watch.prefixes])))
        else:
            del self._watches[connection]
            self._journal.drop(Key("watch", connection))


_NOBODY: dict[str, None] = {}
_encode = msgspec.msgpack.Encoder().encode
_watched = msgspec.msgpack.Decoder(tuple[tuple[str, ...], tuple[str, ...]])
