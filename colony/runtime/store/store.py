"""Where a server keeps what must survive its death: a map from keys to bytes, changed by whole commits.

A server's state lives in memory; each change of it is put into a `Journal` too, and the journal goes to the
store in one commit before any answer leaves. So whatever was acknowledged is in the store, and of a batch
that was not committed nothing is.

A store may have no room for more. Then its server accepts nothing that must be kept, and goes on with all
else: what changes by itself (variables that actuators set, checkpoints) waits in the journal until there is
room. What was promised never waits: where it cannot be kept, the server ends instead of saying so.

A server that is started again loads all of it. What the bytes mean is the server's business; a store promises
that they are those that were committed; it keeps what is damaged aside, all of it, says so, and has nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
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


class StoreFull(StoreError):
    """There is no room for what was to be kept, and nothing of it was."""


class Store(Protocol):
    """Keeps entries."""

    @property
    def full(self) -> str | None:
        """The reason why nothing new should be promised, None while there is room. It stays until
        `make_room`."""
        ...

    def make_room(self) -> None:
        """Look whether there is room again; it takes a moment, so not for every message."""
        ...

    def load(self) -> Iterable[tuple[Key, bytes]]:
        """Every entry that was committed, in no particular order.

        Raises:
            StoreError: they cannot be read.
        """
        ...

    def commit(self, changes: Mapping[Key, bytes | None]) -> None:
        """Set entries, and remove those that are None: all of them, or none.

        Raises:
            StoreFull: there is no room for them; `full` says so from now on.
            StoreError: it could not be done.
        """
        ...

    def close(self) -> None:
        """Nothing is committed any more. May be called again."""
        ...


class MemoryStore:
    """A store that lives as long as its process, for runs in virtual time. Mutable: the entries."""

    full: str | None = None

    def __init__(self) -> None:
        self._entries: dict[Key, bytes] = {}

    def make_room(self) -> None:
        """There always is."""

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


class UnmadeStore:
    """A store that cannot be made yet, because its disk is full.

    It has nothing and keeps nothing until it can be made. Mutable: the store, once there is one.

    Args:
        make: makes the store, or raises `StoreFull`.
        problem: why it could not be made so far.
    """

    def __init__(self, make: Callable[[], Store], problem: StoreFull) -> None:
        self._make = make
        self._problem = str(problem)
        self._store: Store | None = None

    @property
    def full(self) -> str | None:
        return self._problem if self._store is None else self._store.full

    def make_room(self) -> None:
        if self._store is not None:
            self._store.make_room()
            return
        try:
            self._store = self._make()
        except StoreFull as problem:
            self._problem = str(problem)

    def load(self) -> Iterable[tuple[Key, bytes]]:
        return ()

    def commit(self, changes: Mapping[Key, bytes | None]) -> None:
        if self._store is None:
            raise StoreFull(self._problem)
        self._store.commit(changes)

    def close(self) -> None:
        if self._store is not None:
            self._store.close()


class Journal:
    """The changes since the last commit. Mutable: those, and whether they wait for room."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._changes: dict[Key, bytes | None] = {}
        self._promised = self._waiting = False

    @property
    def full(self) -> str | None:
        """The reason why nothing new should be promised, None while there is room."""
        return self._store.full

    def make_room(self) -> None:
        """Look whether there is room again; what waits is tried again in any case."""
        self._store.make_room()
        self._waiting = False

    def put(self, key: Key, data: bytes) -> None:
        """An entry is new, or is changed."""
        self._changes[key] = data

    def drop(self, key: Key) -> None:
        """An entry is gone; one that never was may be dropped too."""
        self._changes[key] = None

    def promise(self) -> None:
        """Note that a caller is about to be answered that the changes so far are kept."""
        self._promised = True

    def settle(self) -> None:
        """Commit what there is; where there is no room for it, and nothing was promised, it waits.

        Raises:
            StoreError: it could not be done; the server's memory is then ahead of the store, so it must end.
        """
        if not self._changes or (self._waiting and not self._promised):
            return
        try:
            self._store.commit(self._changes)
        except StoreFull:
            if self._promised:
                raise
            self._waiting = True
        else:
            self._changes = {}
            self._promised = self._waiting = False
