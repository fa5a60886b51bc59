"""A store in one SQLite file.

Durability. A commit appends to the write-ahead log with plain writes. Once they are done, the operating
system has the bytes, and they survive a SIGKILL of the process, whether synchronized to the disk or not. So
the default is `synchronous=NORMAL`, which synchronizes only when the log is checkpointed into the
database, about every four megabytes. `OFF` would be no faster in between, and a loss of power could
leave an unreadable file; with `NORMAL` it costs only the latest changes, never the file. With `fsync` each
commit waits for the disk (`synchronous=FULL`), and a loss of power costs nothing.

The file is locked while it is open, so that two servers cannot share it. Pages are small because most entries
are, and a commit writes whole pages. Each entry has a checksum, because the file format has none. The table
has row ids, so that the keys have their own index: otherwise a search among entries of a megabyte would read
every entry that it passes.

Full disk. A reserve file in the same folder occupies space. When a commit finds no space, the store
releases the reserve, checkpoints the log into the database, and retries the commit, so that work in progress
can be kept. From then on the store is `full`, until there is space for the reserve again. A file size limit
or a quota counts as a full disk.

Damage. An empty or damaged file is quarantined, and the store starts empty; the store
reports that, and DServer keeps reporting it. An empty file counts as damaged because the store never creates
one: it fills a new database under another name first. A file that is not DServer's, or is from a later
version, is refused and left unchanged.
"""

from __future__ import annotations

import errno
import fcntl
import itertools
import os
import resource
import sqlite3
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, suppress
from pathlib import Path

from colony.files import limit_advice, open_descriptor, open_regular, reason, sync_folder
from colony.runtime.store.store import RESERVE_BYTES, Key, Reserve, StoreError, StoreFullError

# --- quarantine ----------------------------------------------------------------------------------------
#
# Quarantine of damaged databases: each is renamed to `<name>.damaged-1` and so on, together with its log.
#
# Nothing is deleted or overwritten. A quarantined database stays until a user removes it.


COMPANION_SUFFIXES = ("-wal", "-journal", "-shm")
"""Suffixes of the files that SQLite keeps in addition to a database."""


def quarantine(path: Path) -> Path:
    """Rename a database and its companion files, and return the new name.

    Raises:
        BlockingIOError: another process has the database open.
        OSError: a file cannot be renamed.
    """
    _check_unused(path)
    for number in itertools.count(1):
        quarantined_path = path.with_name(f"{path.name}.damaged-{number}")
        if not any(
            os.path.lexists(_with_suffix(quarantined_path, suffix)) for suffix in ("", *COMPANION_SUFFIXES)
        ):
            break
    for suffix in ("", *COMPANION_SUFFIXES):  # database first: without its log, it could look intact
        if os.path.lexists(_with_suffix(path, suffix)):
            os.rename(_with_suffix(path, suffix), _with_suffix(quarantined_path, suffix))
    sync_folder(path.parent)
    return quarantined_path


def list_quarantined(path: Path) -> tuple[Path, ...]:
    """Return the quarantined databases, including those of which only the log is left."""
    try:
        names = os.listdir(path.parent)
    except OSError:
        return ()
    prefix = f"{path.name}.damaged-"
    numbers = {name.removeprefix(prefix).partition("-")[0] for name in names if name.startswith(prefix)}
    return tuple(path.with_name(f"{prefix}{n}") for n in sorted(filter(str.isdecimal, numbers), key=int))


def damage_notes(path: Path) -> tuple[str, ...]:
    """Return a sentence for users about each quarantined database, or its log if nothing else is left."""
    return tuple(
        f"its file was damaged, so it started empty; remove {_first_existing(damaged)} when it is not needed"
        for damaged in list_quarantined(path)
    )


def _first_existing(quarantined_path: Path) -> Path:
    return next(
        (
            file
            for suffix in ("", *COMPANION_SUFFIXES)
            if os.path.lexists(file := _with_suffix(quarantined_path, suffix))
        ),
        quarantined_path,
    )


def _check_unused(path: Path) -> None:
    """Raise BlockingIOError if another process holds SQLite's locks on the database."""
    try:
        descriptor = open_descriptor(path, os.O_RDWR)
    except FileNotFoundError:
        return
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    finally:
        os.close(descriptor)


def _with_suffix(path: Path, suffix: str) -> Path:
    return path.with_name(path.name + suffix)


# --- sqlite --------------------------------------------------------------------------------------------


APPLICATION = 0x436F6C44
"""`ColD`: the application id that marks a file as DServer's."""

VERSION = 2
"""Schema version of the table. Version 1 had no row ids; its files are converted."""

_PAGE = 1024
_CHECKPOINT_PAGES = 4096  # pages of the log: four megabytes

_TABLE = """
CREATE TABLE state (
    kind TEXT NOT NULL, name TEXT NOT NULL, slot INTEGER NOT NULL, data BLOB NOT NULL, sum INTEGER NOT NULL,
    PRIMARY KEY (kind, name, slot)
)
"""
_PUT = """
INSERT INTO state VALUES (?, ?, ?, ?, ?)
ON CONFLICT (kind, name, slot) DO UPDATE SET data = excluded.data, sum = excluded.sum
"""
_DROP = "DELETE FROM state WHERE kind = ? AND name = ? AND slot = ?"


class SqliteStore:
    """A store in the SQLite database at `path`, which it creates if missing. Mutable.

    Args:
        path: database; SQLite's log is `<path>-wal`, and the reserve `<path>.reserve`.
        fsync: True if a commit must also survive a loss of power.
        lock_timeout_s: seconds to wait for another server to release the file.
        report: callback for a line to users when the file is damaged and was quarantined.

    Raises:
        StoreFullError: the file is missing, or is of an earlier version, and the disk has no space for a new
            one.
        StoreError: the file cannot be opened or quarantined, is in use, or is not DServer's.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        fsync: bool = False,
        lock_timeout_s: float = 1.0,
        report: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._path = Path(path)
        self._fsync, self._lock_timeout_s, self._report = fsync, lock_timeout_s, report
        self._database: sqlite3.Connection | None = None
        try:
            self._open_or_create()
        except _DamagedStoreError as damage:
            self._start_empty(damage)

    def _open_or_create(self) -> None:
        """Open the database, or create it if there is none."""
        is_new = _check_files(self._path)
        try:
            if is_new:
                _create(self._path)
            self._database = sqlite3.connect(
                self._path, timeout=self._lock_timeout_s, isolation_level=None, check_same_thread=False
            )
            self._prepare(self._database, self._fsync)
        except (sqlite3.Error, UnicodeDecodeError) as problem:  # the latter from messages about damage
            self._disconnect()
            raise self._error(problem) from None
        except BaseException:
            self._disconnect()
            raise
        self._reserve = Reserve(self._path.with_name(self._path.name + ".reserve"))
        self.full: str | None = None
        self.check_space()

    def check_space(self) -> None:
        """Allocate the reserve if it was released; if there is no space for it, the store stays full."""
        try:
            _check_growth(self._path)
            self._reserve.take()
        except OSError as problem:
            self.full = str(self._full_error(problem))
        else:
            self.full = None

    def _start_empty(self, damage: _DamagedStoreError) -> None:
        """Quarantine a damaged database and create a new one."""
        self._disconnect()
        try:
            renamed = quarantine(self._path)
        except BlockingIOError:
            raise StoreError(f"{self._path} is in use by another server") from None
        except OSError as problem:
            raise StoreError(f"{damage}; it cannot be renamed: {reason(problem)}") from None
        self._report(f"{damage}; it is kept as {renamed.name}, and DServer starts empty")
        self._open_or_create()

    def load(self) -> Iterator[tuple[Key, bytes]]:
        """Return every committed entry; quarantine a damaged database and return no entries."""
        try:
            entries = list(self._entries())
        except _DamagedStoreError as damage:
            self._start_empty(damage)
            entries = []
        return iter(entries)

    def _entries(self) -> Iterator[tuple[Key, bytes]]:
        try:
            for kind, name, slot, data, checksum in self._open().execute("SELECT * FROM state"):
                key = Key(kind, name, slot)
                if not isinstance(data, bytes) or checksum != _checksum(key, data):
                    raise _DamagedStoreError(self._path, f"the {kind} `{name}` has a wrong checksum")
                yield key, data
        except (sqlite3.Error, UnicodeDecodeError) as problem:
            raise self._error(problem) from None

    def commit(self, changes: Mapping[Key, bytes | None]) -> None:
        """Commit the changes; if the disk is full, release the reserve and retry once."""
        try:
            self._commit(changes)
        except StoreFullError as problem:
            self.full = str(problem)
            self._reserve.release()
            self._checkpoint_log()
            self._commit(changes)

    def _commit(self, changes: Mapping[Key, bytes | None]) -> None:
        database = self._open()
        try:
            database.execute("BEGIN")
            database.executemany(
                _PUT, [(*k, data, _checksum(k, data)) for k, data in changes.items() if data is not None]
            )
            dropped = [key for key, data in changes.items() if data is None]
            if dropped:
                database.executemany(_DROP, dropped)
            database.execute("COMMIT")
        except sqlite3.Error as problem:
            if database.in_transaction:
                database.execute("ROLLBACK")
            raise self._error(problem) from None

    def close(self) -> None:
        """Checkpoint the log into the database, and release the file."""
        database, self._database = self._database, None
        if database is not None:
            self._reserve.release()
            database.close()

    def _checkpoint_log(self) -> None:
        """Checkpoint the log into the database as far as there is space, and truncate the log."""
        with suppress(sqlite3.Error):
            self._open().execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()

    # --- opening ---------------------------------------------------------------------------------------

    def _prepare(self, database: sqlite3.Connection, fsync: bool) -> None:
        database.execute("PRAGMA locking_mode = EXCLUSIVE")
        self._check_owner(database)
        mode = database.execute("PRAGMA journal_mode = WAL").fetchone()[0]
        if mode != "wal":
            raise StoreError(f"{self._path}: SQLite cannot keep a write-ahead log here (mode `{mode}`)")
        database.execute(f"PRAGMA synchronous = {'FULL' if fsync else 'NORMAL'}")
        database.execute(f"PRAGMA wal_autocheckpoint = {_CHECKPOINT_PAGES}")
        # overwriting deleted data with zeros would double the writes
        database.execute("PRAGMA secure_delete = OFF")
        database.execute("BEGIN EXCLUSIVE")
        if database.execute("PRAGMA user_version").fetchone()[0] == 1:
            database.execute("ALTER TABLE state RENAME TO state_1")
            _fill(database)
            database.execute("INSERT INTO state SELECT * FROM state_1")
            database.execute("DROP TABLE state_1")
        database.execute("COMMIT")
        result = database.execute("PRAGMA integrity_check(1)").fetchone()[0]
        if result != "ok":
            raise _DamagedStoreError(self._path, result)

    def _check_owner(self, database: sqlite3.Connection) -> None:
        """Refuse a database of another program or of a later version, before anything is written to it."""
        owner = database.execute("PRAGMA application_id").fetchone()[0]
        version = database.execute("PRAGMA user_version").fetchone()[0]
        if owner == APPLICATION and version in (1, VERSION):
            return
        if owner == APPLICATION:
            raise StoreError(f"{self._path} has version {version}; this server expects version {VERSION}")
        if owner != 0 or database.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0]:
            raise StoreError(f"{self._path} is another program's database; give DServer its own file")
        raise _DamagedStoreError(self._path, "it has no tables")

    def _open(self) -> sqlite3.Connection:
        if self._database is None:
            raise StoreError(f"{self._path} is closed")
        return self._database

    def _disconnect(self) -> None:
        if self._database is not None:
            self._database.close()
            self._database = None

    def _error(self, problem: Exception) -> StoreError:
        code = getattr(problem, "sqlite_errorcode", None)
        primary = None if code is None else code & 0xFF
        if primary in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            return StoreError(f"{self._path} is in use by another server")
        if code == sqlite3.SQLITE_IOERR_WRITE and _file_size_limit() is not None:
            return self._full_error(_file_too_large_error(self._path))
        if primary == sqlite3.SQLITE_FULL or code == sqlite3.SQLITE_IOERR_WRITE:
            return self._full_error(problem)
        if primary in _DAMAGE or isinstance(problem, UnicodeDecodeError):
            return _DamagedStoreError(self._path, str(problem))
        return StoreError(f"{self._path}: {problem}")

    def _full_error(self, problem: Exception) -> StoreFullError:
        advice = limit_advice(problem) if isinstance(problem, OSError) else None
        default = f"free some space in {self._path.parent}"
        return StoreFullError(f"{self._path}: {reason(problem)}: {advice or default}")


class _DamagedStoreError(StoreError):
    """A database that does not have the content that DServer wrote."""

    def __init__(self, path: Path, problem: str) -> None:
        super().__init__(f"{path} is damaged: {problem}")


_DAMAGE = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR)
"""SQLite's error codes for damaged content; the last one covers missing tables."""

_HEADER = b"SQLite format 3\0"


def _check_files(path: Path) -> bool:
    """Return True if there is no database; reject files that are unreadable, empty, or not a database."""
    for suffix in COMPANION_SUFFIXES:
        _read_header(path.with_name(path.name + suffix))
    header, log = _read_header(path), _read_header(path.with_name(f"{path.name}-wal"))
    if header is None and log:
        raise _DamagedStoreError(path, "it is missing, but its log exists")
    if header == b"":
        raise _DamagedStoreError(path, "it is empty")
    if header is not None and header != _HEADER:
        raise _DamagedStoreError(path, "it is not a database")
    return header is None


def _read_header(path: Path) -> bytes | None:
    try:
        with open_regular(path) as file:
            return file.read(len(_HEADER))
    except FileNotFoundError:
        return None
    except OSError as problem:
        raise StoreError(f"{path} cannot be read: {reason(problem)}") from None


def _create(path: Path) -> None:
    """Create a database without entries, atomically."""
    temporary = path.with_name(f"{path.name}.new")
    try:
        _discard(temporary)  # left by a server that was killed while creating it
        try:
            with closing(sqlite3.connect(temporary, isolation_level=None)) as database:
                database.execute(f"PRAGMA page_size = {_PAGE}")
                database.execute("BEGIN")
                _fill(database)
                database.execute("COMMIT")
            os.rename(temporary, path)
        except BaseException:
            _discard(temporary)
            raise
        sync_folder(path.parent)
    except OSError as problem:
        raise StoreError(f"{path}: {reason(problem)}") from None


def _fill(database: sqlite3.Connection) -> None:
    database.execute(_TABLE)
    database.execute(f"PRAGMA application_id = {APPLICATION}")
    database.execute(f"PRAGMA user_version = {VERSION}")


def _discard(path: Path) -> None:
    for suffix in ("", *COMPANION_SUFFIXES):
        path.with_name(path.name + suffix).unlink(missing_ok=True)


def _check_growth(path: Path) -> None:
    """Check that the file may grow by the size of the reserve: a file size limit ignores the reserve.

    Raises:
        OSError: the file may not grow that much.
    """
    limit = _file_size_limit()
    if limit is not None and path.stat().st_size + RESERVE_BYTES > limit:
        raise _file_too_large_error(path)


def _file_size_limit() -> int | None:
    """Return the file size limit in bytes, or None if there is none."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return None if limit == resource.RLIM_INFINITY else limit


def _file_too_large_error(path: Path) -> OSError:
    return OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))


def _checksum(key: Key, data: bytes) -> int:
    return zlib.crc32(data, zlib.crc32(f"{key.kind}\0{key.name}\0{key.slot}".encode()))
