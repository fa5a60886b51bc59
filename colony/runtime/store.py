"""Where a server keeps what must survive its death: a map from keys to bytes, changed by whole commits.

A server's state lives in memory; each change of it is put into a `Journal` too, and the journal goes to the
store in one commit before any answer leaves. So whatever was acknowledged is in the store, and of a batch
that was not committed nothing is.

A server that is started again loads all of it. What the bytes mean is the server's business; a store promises
that they are those that were committed; it keeps what is damaged aside, all of it, says so, and has nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple, Protocol

Kind = Literal["fact", "variable", "value", "semaphore", "hold", "pending", "answer", "watch", "checkpoint"]
"""What an entry is about."""


class Key(NamedTuple):
    """Of one entry; `slot` counts entries of one name."""

    kind: Kind
    name: str
    slot: int = 0


class StoreError(Exception):
    """A store cannot be opened, read or written; the message names it and tells why and what to do."""


class Store(Protocol):
    """Keeps entries."""

    def load(self) -> Iterable[tuple[Key, bytes]]:
        """Every entry that was committed, in no particular order.

        Raises:
            StoreError: they cannot be read.
        """
        ...

    def commit(self, changes: Mapping[Key, bytes | None]) -> None:
        """Set entries, and remove those that are None: all of them, or none.

        Raises:
            StoreError: it could not be done.
        """
        ...

    def close(self) -> None:
        """Nothing is committed any more. May be called again."""
        ...


class MemoryStore:
    """A store that lives as long as its process, for runs in virtual time. Mutable: the entries."""

    def __init__(self) -> None:
        self._entries: dict[Key, bytes] = {}

    def load(self) -> tuple[tuple[Key, bytes], ...]:
        return tuple(self._entries.items())

    def commit(self, changes: Mapping[Key, bytes | None]) -> None:
        for key, data in changes.items():
            if data is None:
                self._entries.pop(key, None)
            else:
                self._entries[key] = data

    def close(self) -> None:
        """It holds nothing."""


class Journal:
    """The changes since the last commit. Mutable: those."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._changes: dict[Key, bytes | None] = {}

    def put(self, key: Key, data: bytes) -> None:
        """An entry is new, or is changed."""
        self._changes[key] = data

    def drop(self, key: Key) -> None:
        """An entry is gone; one that never was may be dropped too."""
        self._changes[key] = None

    def settle(self) -> None:
        """Commit what there is.

        Raises:
            StoreError: it could not be done; the server's memory is then ahead of the store, so it must end.
        """
        if self._changes:
            self._store.commit(self._changes)
            self._changes = {}
