"""Results in an SQLite file, one row per run; runs with a stored result are not repeated.

A file has a table for each kind of result. Each row is committed as it arrives, so that no finished run is
lost, even if the experiment ends by SIGKILL.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, NamedTuple, Protocol, TypeVar

import msgspec

from colony.experiment.rows import result_of, row_of, sql_types_of
from colony.files import open_descriptor, reason

VERSION = 1


class RunKey(NamedTuple):
    """The key of a run: its list, its number in the list, the seed of all its randomness, and its variant."""

    runs: str
    number: int
    seed: int
    variant: str


KEY_COLUMNS = RunKey._fields
"""The first columns of each table."""


class StoredResult(Protocol):
    """A result that can be stored."""

    @property
    def key(self) -> RunKey:
        """Key of the run."""
        ...


R = TypeVar("R", bound=StoredResult)


@dataclass(frozen=True, slots=True, kw_only=True)
class Table(Generic[R]):
    """A table of results of one kind.

    Attributes:
        name: name of the table.
        kind: the class of the results, which `rows.py` converts to rows.
        columns: the names of the columns, `KEY_COLUMNS` first.
    """

    name: str
    kind: type[R]
    columns: tuple[str, ...]

    @property
    def sql(self) -> str:
        """The statement that creates the table."""
        kinds = zip(self.columns, sql_types_of(self.kind), strict=True)
        columns = ", ".join(f"{name} {kind} NOT NULL" for name, kind in kinds)
        key = ", ".join(KEY_COLUMNS)
        return f"CREATE TABLE IF NOT EXISTS {self.name} ({columns}, PRIMARY KEY ({key})) WITHOUT ROWID"


_CREATE_FINGERPRINTS = (
    "CREATE TABLE IF NOT EXISTS made "
    "(runs TEXT, variant TEXT, made_with TEXT NOT NULL, PRIMARY KEY (runs, variant))"
)


class ResultsError(Exception):
    """A file of results cannot be used; the message has its name, the reason and a remedy."""


class Results(Generic[R]):
    """A file of results of one kind, created if it does not exist. Mutable.

    Args:
        path: path of the file; None to keep the results in memory.
        table: the kind of results; the same file may contain others.

    Raises:
        ResultsError: the file cannot be opened, or is not a file of results.
    """

    def __init__(self, path: Path | None, table: Table[R]) -> None:
        self._path, self._table = path, table
        with self._reporting_errors():
            if path is not None:
                _expect_file(path)
            where = ":memory:" if path is None else path.absolute()  # to SQLite, some names are no files
            self._file = sqlite3.connect(where, isolation_level=None, timeout=30.0)
            self._file.execute("PRAGMA synchronous = NORMAL")
            self._file.execute("BEGIN IMMEDIATE")  # another process may begin the same file
            self._begin()
            self._file.execute("COMMIT")

    @contextmanager
    def _reporting_errors(self) -> Iterator[None]:
        """Report that the file cannot be used, or has values that no result has.

        Raises:
            ResultsError: it cannot.
        """
        try:
            yield
        except (sqlite3.Error, OSError, ValueError, msgspec.ValidationError) as problem:
            why = reason(problem)
            raise ResultsError(
                f"{self._path} cannot be used for results: {why}; choose another file"
            ) from None

    def _begin(self) -> None:
        version = self._file.execute("PRAGMA user_version").fetchone()[0]
        tables = {
            name for (name,) in self._file.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        }
        if tables and (version != VERSION or "made" not in tables):
            raise ResultsError(f"{self._path} is not a file of results of this version; choose another file")
        if self._table.name not in tables:
            self._file.execute(self._table.sql)
            self._file.execute(_CREATE_FINGERPRINTS)
            self._file.execute(f"PRAGMA user_version = {VERSION}")

    def expect(self, runs: str, variant: str, fingerprint: str) -> None:
        """Check the fingerprint of the stored results of a list and variant; store it if there are none.

        Raises:
            ResultsError: the stored results have another fingerprint, or the file cannot be written.
        """
        where = "SELECT made_with FROM made WHERE runs = ? AND variant = ?"
        with self._reporting_errors():
            self._file.execute("INSERT OR IGNORE INTO made VALUES (?, ?, ?)", (runs, variant, fingerprint))
            (found,) = self._file.execute(where, (runs, variant)).fetchone()
        if found != fingerprint:
            raise ResultsError(
                f"{self._path} has results of `{runs}` from another program, map, version of colony, or with "
                "other options; choose another file with -o, or remove that one"
            )

    def put(self, result: R) -> None:
        """Store a result, replacing one with the same key.

        Raises:
            ResultsError: the file cannot be written.
        """
        placeholders = ", ".join("?" * len(self._table.columns))
        row = row_of(self._table.kind, result)
        with self._reporting_errors():
            self._file.execute(f"INSERT OR REPLACE INTO {self._table.name} VALUES ({placeholders})", row)

    def keys(self) -> frozenset[RunKey]:
        """Return the keys of the stored results."""
        query = f"SELECT {', '.join(KEY_COLUMNS)} FROM {self._table.name}"
        with self._reporting_errors():
            return frozenset(RunKey(*row) for row in self._file.execute(query))

    def select(self, runs: str, variant: str) -> tuple[R, ...]:
        """Return the results of a list and variant, by number and seed."""
        columns = ", ".join(self._table.columns)
        where = "runs = ? AND variant = ? ORDER BY number, seed"
        query = f"SELECT {columns} FROM {self._table.name} WHERE {where}"
        with self._reporting_errors():
            rows = self._file.execute(query, (runs, variant))
            return tuple(result_of(self._table.kind, iter(row)) for row in rows)

    def close(self) -> None:
        """Close the file; closing it again does nothing."""
        self._file.close()

    def __enter__(self) -> Results[R]:
        """Return the results themselves."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close the file."""
        self.close()


def _expect_file(path: Path) -> None:
    """Refuse a pipe or a device, on which SQLite would block; the file need not exist."""
    with suppress(FileNotFoundError):
        os.close(open_descriptor(path))
