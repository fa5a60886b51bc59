"""Stores: what was committed is loaded, all of a commit or nothing, and what is damaged is told."""

from __future__ import annotations

import random
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from colony.runtime.sqlite_store import SqliteStore
from colony.runtime.store import Journal, Key, MemoryStore, Store, StoreError

X, Y = Key("value", "X", 0), Key("value", "a\0b é", 1)
Make = Callable[[], Store]


@pytest.fixture(params=["memory", "sqlite", "sqlite with fsync"])
def make(request: pytest.FixtureRequest, tmp_path: Path) -> Make:
    """Opens one store, again and again."""
    if request.param == "memory":
        kept = MemoryStore()
        return lambda: kept
    return lambda: SqliteStore(tmp_path / "state.db", fsync=request.param != "sqlite")


def test_what_was_committed_is_there_and_what_was_dropped_is_not(make: Make) -> None:
    store = make()
    assert dict(store.load()) == {}
    store.commit({X: b"1", Y: b"2", Key("fact", "X"): b""})
    store.commit({X: b"3" * 100_000, Y: None, Key("fact", "never"): None})
    for _ in range(2):
        assert dict(store.load()) == {X: b"3" * 100_000, Key("fact", "X"): b""}
        store.close()
        store.close()
        store = make()
    store.close()


def test_a_journal_commits_the_newest_of_each_entry() -> None:
    store = MemoryStore()
    journal = Journal(store)
    journal.put(X, b"1")
    journal.put(X, b"2")
    journal.put(Y, b"3")
    journal.drop(Y)
    assert dict(store.load()) == {}
    journal.settle()
    assert dict(store.load()) == {X: b"2"}
    journal.drop(X)
    journal.settle()
    assert dict(store.load()) == {}


# --- what is not a store -------------------------------------------------------------------------


def filled(path: Path, entries: int = 400) -> Path:
    store = SqliteStore(path)
    store.commit({Key("value", f"V{i}"): bytes([i % 256]) * 50 for i in range(entries)})
    store.close()
    return path


def refusal(path: Path) -> str:
    with pytest.raises(StoreError) as failed:
        content(path)
    assert str(path) in str(failed.value)
    return str(failed.value)


def content(path: Path) -> dict[Key, bytes]:
    store = SqliteStore(path)
    try:
        return dict(store.load())
    finally:
        store.close()


def test_a_file_of_something_else(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_bytes(b"remember the milk\n" * 1000)
    assert "is no database" in refusal(path)
    assert path.read_bytes() == b"remember the milk\n" * 1000


def test_another_programs_database(tmp_path: Path) -> None:
    path = tmp_path / "other.db"
    other = sqlite3.connect(path)
    other.execute("CREATE TABLE state (kind, name, slot, data, sum)")
    other.commit()
    other.close()
    before = path.read_bytes()
    assert "another program's database" in refusal(path)
    assert path.read_bytes() == before


def test_a_later_version(tmp_path: Path) -> None:
    path = filled(tmp_path / "state.db")
    later = sqlite3.connect(path)
    later.execute("PRAGMA user_version = 3")
    later.close()
    assert "version 3" in refusal(path)


def test_a_file_of_version_1_is_converted(tmp_path: Path) -> None:
    path = filled(tmp_path / "state.db")
    expected = content(path)
    database = sqlite3.connect(path)
    database.executescript("""
        ALTER TABLE state RENAME TO new;
        CREATE TABLE state (
            kind TEXT NOT NULL, name TEXT NOT NULL, slot INTEGER NOT NULL, data BLOB NOT NULL,
            sum INTEGER NOT NULL, PRIMARY KEY (kind, name, slot)
        ) WITHOUT ROWID;
        INSERT INTO state SELECT * FROM new;
        DROP TABLE new;
        PRAGMA user_version = 1;
    """)
    database.close()
    assert len(expected) == 400
    for _ in range(2):
        assert content(path) == expected
    store = SqliteStore(path)
    store.commit({Key("value", "V0"): b"new", Key("value", "V1"): None})
    store.close()
    expected[Key("value", "V0")] = b"new"
    del expected[Key("value", "V1")]
    assert content(path) == expected


def test_a_folder_that_is_not_there_and_a_folder_in_its_place(tmp_path: Path) -> None:
    refusal(tmp_path / "none" / "state.db")
    refusal(tmp_path)


def test_a_file_cut_short(tmp_path: Path) -> None:
    path = filled(tmp_path / "state.db")
    whole = path.read_bytes()
    for size in (50, 100, 1024, 3000, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        assert "damaged" in refusal(path) or "no database" in refusal(path)


def test_what_is_loaded_of_a_damaged_file_is_right_or_it_is_told(tmp_path: Path) -> None:
    path = filled(tmp_path / "state.db")
    whole, expected = path.read_bytes(), content(path)
    draw, told = random.Random(1), 0
    for _ in range(60):
        damaged = bytearray(whole)
        length = draw.choice((1, 4, 1024))
        first = draw.randrange(len(whole) - length)
        damaged[first : first + length] = draw.randbytes(length)
        path.write_bytes(damaged)
        try:
            assert content(path) == expected
        except StoreError:
            told += 1
    assert told > 30


def test_an_empty_file_beside_its_log(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    store = SqliteStore(path)
    store.commit({X: b"1"})
    copy = tmp_path / "copy.db"
    (tmp_path / "copy.db-wal").write_bytes((tmp_path / "state.db-wal").read_bytes())
    store.close()
    for _ in range(2):
        assert "its log copy.db-wal is there" in refusal(copy)
        copy.write_bytes(b"")


def test_an_empty_file_is_a_new_store(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    path.write_bytes(b"")
    store = SqliteStore(path)
    assert dict(store.load()) == {}
    store.close()


def test_a_store_has_one_server(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    store = SqliteStore(path)
    with pytest.raises(StoreError, match="in use"):
        SqliteStore(path, patience_s=0.0)
    store.commit({X: b"1"})
    store.close()
    with pytest.raises(StoreError, match="is closed"):
        store.commit({X: b"2"})


def test_a_commit_that_cannot_be_done_is_told_and_undone(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    store = SqliteStore(path)
    store.commit({X: b"1"})
    assert store._database is not None
    pages = store._database.execute("PRAGMA page_count").fetchone()[0]
    store._database.execute(f"PRAGMA max_page_count = {pages + 5}")
    with pytest.raises(StoreError, match="full"):
        store.commit({X: b"2", Y: b"2" * 100_000})
    assert dict(store.load()) == {X: b"1"}
    store.close()
    reopened = SqliteStore(path)
    assert dict(reopened.load()) == {X: b"1"}
    reopened.close()
