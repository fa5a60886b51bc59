"""Results in one SQLite file, a row a run: what is there need not be run again.

A file has a table for each kind of result that is kept in it; `RUN_TABLE` is that of runs as such.

Each row is committed as it comes, so that whatever ends an experiment, SIGKILL included, costs no run that
was finished. Anything that reads SQLite can go on from there; docs/experiments.md has the columns.
"""

from __future__ import annotations

import os
import sqlite3
from array import array
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Generic, Protocol, TypeVar

from colony.experiment.record import Contacts, LightCount, ModeCount, RunKey, RunResult
from colony.files import open_descriptor, reason

VERSION = 1

COLUMNS = {
    "runs": "TEXT NOT NULL",
    "number": "INTEGER NOT NULL",
    "seed": "INTEGER NOT NULL",
    "variant": "TEXT NOT NULL",
    "origin": "TEXT NOT NULL",
    "goal": "TEXT NOT NULL",
    "failure": "TEXT NOT NULL",
    "failed_mode": "TEXT NOT NULL",
    "remark": "TEXT NOT NULL",
    "along_mm": "REAL NOT NULL",
    "off_mm": "REAL NOT NULL",
    "distance_mm": "REAL NOT NULL",
    "travelled_mm": "REAL NOT NULL",
    "time_s": "REAL NOT NULL",
    "top_mm_s": "REAL NOT NULL",
    "l_entered": "INTEGER NOT NULL",
    "l_completed": "INTEGER NOT NULL",
    "l_needed": "INTEGER NOT NULL",
    "c_entered": "INTEGER NOT NULL",
    "c_completed": "INTEGER NOT NULL",
    "c_needed": "INTEGER NOT NULL",
    "d_entered": "INTEGER NOT NULL",
    "d_completed": "INTEGER NOT NULL",
    "d_needed": "INTEGER NOT NULL",
    "letters": "TEXT NOT NULL",
    "completed": "INTEGER NOT NULL",
    "first_light": "INTEGER NOT NULL",
    "lights_seen": "INTEGER NOT NULL",
    "lights_missed": "INTEGER NOT NULL",
    "lights_false": "INTEGER NOT NULL",
    "contacts": "INTEGER NOT NULL",
    "contact_mm_s": "REAL NOT NULL",
    "hazards": "TEXT NOT NULL",
    "path": "BLOB NOT NULL",
}
"""The columns of the table `run`, with their types."""

KEY_COLUMNS = {name: COLUMNS[name] for name in ("runs", "number", "seed", "variant")}
"""The first columns of each table: the fields of `RunKey`."""


class Kept(Protocol):
    """A result that can be kept."""

    @property
    def key(self) -> RunKey: ...


R = TypeVar("R", bound=Kept)


@dataclass(frozen=True, slots=True, kw_only=True)
class Table(Generic[R]):
    """How results of one kind are kept.

    Attributes:
        name: of the table.
        columns: with their types; `KEY_COLUMNS` come first.
        row: a result as a row.
        result: a row as a result.
    """

    name: str
    columns: Mapping[str, str]
    row: Callable[[R], tuple[object, ...]]
    result: Callable[[tuple[Any, ...]], R]

    @property
    def sql(self) -> str:
        """What makes the table."""
        columns = ", ".join(f"{name} {kind}" for name, kind in self.columns.items())
        key = ", ".join(KEY_COLUMNS)
        return f"CREATE TABLE IF NOT EXISTS {self.name} ({columns}, PRIMARY KEY ({key})) WITHOUT ROWID"


_MADE = (
    "CREATE TABLE IF NOT EXISTS made "
    "(runs TEXT, variant TEXT, made_with TEXT NOT NULL, PRIMARY KEY (runs, variant))"
)


class ResultsError(Exception):
    """A file of results cannot be used; the message names it and tells why and what to do."""


class Results(Generic[R]):
    """A file of results of one kind; made where there is none. Mutable: the file.

    Args:
        path: of the file; None: in memory, for this process alone.
        table: the kind; there may be others in the same file.

    Raises:
        ResultsError: it cannot be opened, or is something else.
    """

    def __init__(self, path: Path | None, table: Table[R]) -> None:
        self._path, self._table = path, table
        try:
            if path is not None:
                _expect_file(path)
            self._file = sqlite3.connect(path or ":memory:", isolation_level=None, timeout=30.0)
            self._file.execute("PRAGMA journal_mode = WAL")
            self._file.execute("PRAGMA synchronous = NORMAL")
            self._begin()
        except (sqlite3.Error, OSError) as problem:
            why = reason(problem)
            raise ResultsError(f"{path} cannot be used for results: {why}; choose another file") from None

    def _begin(self) -> None:
        version = self._file.execute("PRAGMA user_version").fetchone()[0]
        tables = {
            name for (name,) in self._file.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        }
        if tables and (version != VERSION or "made" not in tables):
            raise ResultsError(f"{self._path} has no results of this version; choose another file")
        if self._table.name not in tables:
            self._file.execute("BEGIN IMMEDIATE")
            self._file.execute(self._table.sql)
            self._file.execute(_MADE)
            self._file.execute(f"PRAGMA user_version = {VERSION}")
            self._file.execute("COMMIT")

    def expect(self, runs: str, variant: str, made_with: str) -> None:
        """Say what the results of a list and variant are made with, besides their keys.

        Raises:
            ResultsError: those that are there were made with something else.
        """
        self._file.execute("INSERT OR IGNORE INTO made VALUES (?, ?, ?)", (runs, variant, made_with))
        where = "SELECT made_with FROM made WHERE runs = ? AND variant = ?"
        (found,) = self._file.execute(where, (runs, variant)).fetchone()
        if found != made_with:
            raise ResultsError(
                f"{self._path} has results of `{runs}` that were made with another program or map; choose "
                "another file with -o, or remove that one"
            )

    def put(self, result: R) -> None:
        """Keep a result; one with the same key is replaced.

        Raises:
            ResultsError: the file cannot be written.
        """
        marks = ", ".join("?" * len(self._table.columns))
        try:
            row = self._table.row(result)
            self._file.execute(f"INSERT OR REPLACE INTO {self._table.name} VALUES ({marks})", row)
        except sqlite3.Error as problem:
            raise ResultsError(f"{self._path} cannot be written: {problem}") from None

    def keys(self) -> frozenset[RunKey]:
        """The runs whose results are there."""
        query = f"SELECT {', '.join(KEY_COLUMNS)} FROM {self._table.name}"
        return frozenset(RunKey(*row) for row in self._file.execute(query))

    def of(self, runs: str, variant: str) -> tuple[R, ...]:
        """The results of a list and variant, by number and seed."""
        columns = ", ".join(self._table.columns)
        where = "runs = ? AND variant = ? ORDER BY number, seed"
        query = f"SELECT {columns} FROM {self._table.name} WHERE {where}"
        return tuple(map(self._table.result, self._file.execute(query, (runs, variant))))

    def close(self) -> None:
        """End it; again is nothing."""
        self._file.close()

    def __enter__(self) -> Results[R]:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _expect_file(path: Path) -> None:
    """Refuse a pipe or a device, for which SQLite would wait; there may be no file yet."""
    with suppress(FileNotFoundError):
        os.close(open_descriptor(path))


def _row(result: RunResult) -> tuple[object, ...]:
    return (
        *result.key,
        result.origin,
        result.goal,
        result.failure,
        result.failed_mode,
        result.remark,
        result.along_mm,
        result.off_mm,
        result.distance_mm,
        result.travelled_mm,
        result.time_s,
        result.top_mm_s,
        *(number for mode in result.modes for number in mode),
        result.letters,
        result.completed,
        result.first_light,
        *result.lights,
        *result.contacts,
        result.hazards,
        array("i", (number for place in result.path for number in place)).tobytes(),
    )


def _result(row: tuple[Any, ...]) -> RunResult:
    numbers = array("i")
    numbers.frombytes(row[33])
    return RunResult(
        key=RunKey(*row[0:4]),
        origin=row[4],
        goal=row[5],
        failure=row[6],
        failed_mode=row[7],
        remark=row[8],
        along_mm=row[9],
        off_mm=row[10],
        distance_mm=row[11],
        travelled_mm=row[12],
        time_s=row[13],
        top_mm_s=row[14],
        modes=(ModeCount(*row[15:18]), ModeCount(*row[18:21]), ModeCount(*row[21:24])),
        letters=row[24],
        completed=row[25],
        first_light=bool(row[26]),
        lights=LightCount(*row[27:30]),
        contacts=Contacts(*row[30:32]),
        hazards=row[32],
        path=tuple(zip(numbers[0::2], numbers[1::2], strict=True)),
    )


RUN_TABLE: Table[RunResult] = Table(name="run", columns=COLUMNS, row=_row, result=_result)
"""Runs as such."""
