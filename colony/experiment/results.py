"""Results in an SQLite file, one row per run; runs with a stored result are not repeated.

A file has a table for each kind of result. Each row is committed as it arrives, so that no finished run is
lost, even if the experiment ends by SIGKILL.
"""

from __future__ import annotations

import json
import os
import sqlite3
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, is_dataclass
from hashlib import sha256
from itertools import chain
from operator import getitem
from pathlib import Path
from typing import (
    Annotated,
    Any,
    Generic,
    Literal,
    NamedTuple,
    Protocol,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec

from colony.execute.colonyc import encode
from colony.execute.compiled import Compiled
from colony.files import StrPath, open_descriptor, reason

# --- digest --------------------------------------------------------------------------------------------
#
# A digest of all that the results of an experiment depend on, apart from its settings.


PACKAGE = Path(__file__).parents[1]


def digest_of(programs: Sequence[Compiled], maps: Iterable[StrPath]) -> str:
    """Return a digest of programs with their sources, of the files of a map, and of colony itself."""
    digest = sha256()
    for program in programs:
        digest.update(encode(program))
    for path in maps:
        digest.update(Path(path).read_bytes())
    for path in sorted(PACKAGE.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


# --- rows ---------------------------------------------------------------------------------------------
#
# Results as rows of a table, whose columns follow from the fields of the class.
#
# A string or a number has its own column, and so has each part of a named tuple, of a tuple of known length,
# and of a mapping with known keys. Any other value is JSON text, except points, which are packed.

Points = Annotated[tuple[tuple[int, int], ...], "packed"]
"""Points, x and y in mm, stored as 32-bit integers."""

_SQL = {str: "TEXT", int: "INTEGER", bool: "INTEGER", float: "REAL", Points: "BLOB"}


def sql_types_of(kind: Any) -> list[str]:
    """Return the SQL types of the columns of a class."""
    parts = _parts(kind)
    if parts is None:
        return [_SQL.get(kind, "TEXT")]
    return [name for part in parts.values() for name in sql_types_of(part)]


def row_of(kind: Any, value: Any) -> list[object]:
    """Return a result of this class as a row."""
    parts = _parts(kind)
    if parts is None:
        return [_cell(kind, value)]
    get = getattr if get_origin(kind) is None else getitem
    return [cell for key, part in parts.items() for cell in row_of(part, get(value, key))]


def result_of(kind: Any, cells: Iterator[Any]) -> Any:
    """Return a result of this class from the cells of a row."""
    parts = _parts(kind)
    if parts is None:
        return _value(kind, next(cells))
    values = {key: result_of(part, cells) for key, part in parts.items()}
    if get_origin(kind) is None:
        return kind(**values)
    return tuple(values.values()) if get_origin(kind) is tuple else values


def _parts(kind: Any) -> dict[Any, Any] | None:
    """Return the types of the parts with own columns, by name, index or key; None for a single column."""
    origin, arguments = get_origin(kind), get_args(kind)
    if is_dataclass(kind) or hasattr(kind, "_fields"):
        return get_type_hints(kind, include_extras=True)
    if origin is tuple and Ellipsis not in arguments:
        return dict(enumerate(arguments))
    if origin is Mapping and get_origin(arguments[0]) is Literal:
        return dict.fromkeys(get_args(arguments[0]), arguments[1])
    return None


def _cell(kind: Any, value: Any) -> object:
    if kind is Points:
        return array("i", chain.from_iterable(value)).tobytes()
    return value if isinstance(value, str | int | float) else json.dumps(value)


def _value(kind: Any, cell: Any) -> object:
    if kind is Points:
        numbers = array("i", cell)
        return tuple(zip(numbers[0::2], numbers[1::2], strict=True))
    if kind is bool:
        return bool(cell)
    return msgspec.convert(json.loads(cell) if get_origin(kind) in (tuple, Mapping) else cell, kind)


# --- results ------------------------------------------------------------------------------------------

VERSION = 2


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
class ResultTable(Generic[R]):
    """A table of results of one kind.

    Attributes:
        name: name of the table.
        kind: the class of the results, which `results.py` converts to rows.
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

    def __init__(self, path: Path | None, table: ResultTable[R]) -> None:
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
