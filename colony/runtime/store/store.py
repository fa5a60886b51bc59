"""Durable state of a server: a map from keys to bytes, changed by atomic commits.

A server's state lives in memory. Each change is also put into a `Journal`, which is written to the store in
one commit before any answer is sent. So all acknowledged changes are in the store, and a batch is committed
as a whole or not at all.

A store may run out of space. Its server then refuses calls whose changes must be kept, and otherwise
continues: unacknowledged changes (variables that actuators set, checkpoints) wait in the journal until there
is space. Acknowledged changes never wait: if one cannot be kept, the server ends instead of acknowledging it.

A restarted server loads all entries. Only the server interprets the bytes. A store guarantees that they are
the bytes that were committed; it quarantines a damaged file as a whole, reports that, and starts empty.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from threading import Lock
from typing import Literal, NamedTuple, Protocol

from colony.files import NO_ROOM, naming

# --- reserve -------------------------------------------------------------------------------------------
#
# Disk space in reserve, so that work in progress can be completed when the disk fills up.


RESERVE_BYTES = 2 << 20
"""Size of the reserve: room for two of the largest values, or a few thousand small changes."""


class Reserve:
    """A file that occupies disk space and has no content. Stateful: the file may exist or not.

    Args:
        path: file on the disk whose space is reserved.
        size: size of the reserve, in bytes.
    """

    def __init__(self, path: Path, size: int = RESERVE_BYTES) -> None:
        self._path = path
        self._size = size

    def take(self) -> None:
        """Allocate the space if it is not yet allocated; do nothing if the file system cannot preallocate.

        Raises:
            OSError: the disk has too little space.
        """
        try:
            file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                with naming(self._path):
                    os.posix_fallocate(file, 0, self._size)
            finally:
                os.close(file)
        except OSError as problem:
            self.release()  # part of the space may have been allocated
            if problem.errno in NO_ROOM:
                raise

    def release(self) -> None:
        """Release the space. Calling this again has no effect."""
        try:
            self._path.unlink(missing_ok=True)
        except OSError:
            return  # a disk that cannot even delete a file has no space to release


# --- store ---------------------------------------------------------------------------------------------


Kind = Literal[
    "fact", "variable", "value", "semaphore", "hold", "pending", "answer", "watch", "checkpoint", "sent"
]
"""The kind of an entry."""


class Key(NamedTuple):
    """The key of one entry; `slot` distinguishes the entries with one name."""

    kind: Kind
    name: str
    slot: int = 0


class StoreError(Exception):
    """A store cannot be opened, read or written; the message gives its path, the reason and the remedy."""


class StoreFullError(StoreError):
    """The store has no space for the changes, and none of them was kept."""


class Store(Protocol):
    """A durable map from keys to bytes."""

    @property
    def full(self) -> str | None:
        """The reason why no new data should be accepted; None while there is space.

        It stays set until `check_space` finds space.
        """
        ...

    def check_space(self) -> None:
        """Check whether there is space again; too slow to be called for every message."""
        ...

    def load(self) -> Iterable[tuple[Key, bytes]]:
        """Return every committed entry, in no particular order.

        Raises:
            StoreError: the entries cannot be read.
        """
        ...

    def commit(self, changes: Mapping[Key, bytes | None]) -> None:
        """Set entries, and remove those that are None, atomically.

        Raises:
            StoreFullError: there is no space for them; `full` gives the reason from now on.
            StoreError: the commit failed.
        """
        ...

    def close(self) -> None:
        """Close the store; nothing can be committed afterwards. Idempotent."""
        ...


class MemoryStore:
    """A store without a file, for runs in virtual time. Mutable."""

    full: str | None = None

    def __init__(self) -> None:
        self._entries: dict[Key, bytes] = {}

    def check_space(self) -> None:
        """Do nothing: memory is not limited here."""

    def load(self) -> tuple[tuple[Key, bytes], ...]:
        """Return every committed entry."""
        return tuple(self._entries.items())

    def commit(self, changes: Mapping[Key, bytes | None]) -> None:
        """Set entries, and remove those that are None."""
        for key, data in changes.items():
            if data is None:
                self._entries.pop(key, None)
            else:
                self._entries[key] = data

    def close(self) -> None:
        """Do nothing: the store holds no resources."""


class PendingStore:
    """A placeholder for a store that cannot be created yet because its disk is full.

    It has no entries and accepts none until the store can be created. Stateful: holds the store once it
    exists.

    Args:
        make: function that creates the store, or raises `StoreFullError`.
        problem: reason why the store could not be created so far.
    """

    def __init__(self, make: Callable[[], Store], problem: StoreFullError) -> None:
        self._make = make
        self._problem = str(problem)
        self._store: Store | None = None

    @property
    def full(self) -> str | None:
        """The reason why no new data should be accepted; None while there is space."""
        return self._problem if self._store is None else self._store.full

    def check_space(self) -> None:
        """Create the store if that is possible now, or let an existing store check for space."""
        if self._store is not None:
            self._store.check_space()
            return
        try:
            self._store = self._make()
        except StoreFullError as problem:
            self._problem = str(problem)

    def load(self) -> Iterable[tuple[Key, bytes]]:
        """Return no entries."""
        return ()

    def commit(self, changes: Mapping[Key, bytes | None]) -> None:
        """Commit to the store.

        Raises:
            StoreFullError: the store could not be created yet, or has no space.
            StoreError: the commit failed.
        """
        if self._store is None:
            raise StoreFullError(self._problem)
        self._store.commit(changes)

    def close(self) -> None:
        """Close the store, if it was created."""
        if self._store is not None:
            self._store.close()


class Journal:
    """The changes since the last commit. Mutable. One thread may change it while another settles it."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._changes: dict[Key, bytes | None] = {}
        self._unkept: dict[Key, bytes | None] = {}  # taken, but not in the store yet
        self._ack_pending = self._must_keep = self._waiting = False
        self._settled = 0
        self._changing, self._committing = Lock(), Lock()

    @property
    def full(self) -> str | None:
        """The reason why no new data should be accepted; None while there is space."""
        return self._store.full

    def check_space(self) -> None:
        """Check whether there is space again; the next `settle` retries the waiting changes in any case."""
        with self._committing:
            self._store.check_space()
        self._waiting = False

    def put(self, key: Key, data: bytes) -> None:
        """Record a new or changed entry."""
        with self._changing:
            self._changes[key] = data

    def drop(self, key: Key) -> None:
        """Record the removal of an entry; the entry need not exist."""
        with self._changing:
            self._changes[key] = None

    def mark_ack_pending(self) -> None:
        """Note that the changes so far are about to be acknowledged, so `settle` must commit them."""
        with self._changing:
            self._ack_pending = True

    def settle(self) -> Callable[[], None] | None:
        """Take the changes, and return a function that commits them, which another thread may call.

        Returns None if there is nothing to commit. If there is no space, changes wait, unless one is about to
        be acknowledged. The function raises StoreError if the commit failed; the server's memory is then
        ahead of the store, so the server must end.
        """
        with self._changing:
            if not (self._changes or self._unkept) or (self._waiting and not self._ack_pending):
                return None
            self._unkept |= self._changes
            self._must_keep |= self._ack_pending
            self._changes, self._ack_pending = {}, False
            self._settled += 1
        return self._commit

    @property
    def unsettled(self) -> bool:
        """True if `settle` has something to commit."""
        return bool(self._changes) and (self._ack_pending or not self._waiting)

    def _commit(self) -> None:
        """Commit all that was taken and is not in the store yet."""
        with self._committing:
            with self._changing:
                changes, must_keep, settled = dict(self._unkept), self._must_keep, self._settled
            if not changes:
                return
            try:
                self._store.commit(changes)
            except StoreError as problem:
                self._waiting = True
                if must_keep or not isinstance(problem, StoreFullError):
                    with self._changing:
                        self._ack_pending = True
                    raise
                return
            self._waiting = False
            with self._changing:
                for key, data in changes.items():
                    if self._unkept.get(key) is data:
                        self._unkept.pop(key, None)
                self._must_keep = self._must_keep and self._settled != settled
