"""Stores: what was committed is loaded, all of a commit or nothing, and what is damaged is kept aside."""

from __future__ import annotations

import os
import random
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from colony.runtime.store.sqlite import SqliteStore, damage_notes, list_quarantined
from colony.runtime.store.store import Journal, Key, MemoryStore, Store, StoreError
from tests.kit.node_stage import settle
from tests.paths import ROOT
from tests.small_disk import small_disk

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
    settle(journal)
    assert dict(store.load()) == {X: b"2"}
    journal.drop(X)
    settle(journal)
    assert dict(store.load()) == {}


# --- what is not a store -------------------------------------------------------------------------


def filled(path: Path, entries: int = 400) -> Path:
    store = SqliteStore(path)
    store.commit({Key("value", f"V{i}"): bytes([i % 256]) * 50 for i in range(entries)})
    store.close()
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return filled(tmp_path / "state.db")


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


def test_another_programs_database(tmp_path: Path) -> None:
    path = tmp_path / "other.db"
    other = sqlite3.connect(path)
    other.execute("CREATE TABLE state (kind, name, slot, data, sum)")
    other.commit()
    other.close()
    before = path.read_bytes()
    assert "another program's database" in refusal(path)
    assert path.read_bytes() == before


def test_a_later_version(path: Path) -> None:
    later = sqlite3.connect(path)
    later.execute("PRAGMA user_version = 3")
    later.close()
    assert "version 3" in refusal(path)


def test_a_file_of_version_1_is_converted(path: Path) -> None:
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
    assert "unable to open" in refusal(tmp_path / "none" / "state.db")
    assert "Is a directory" in refusal(tmp_path)


@pytest.mark.parametrize("ending", ["", "-wal", "-journal", "-shm"])
def test_what_would_keep_the_server_waiting(path: Path, ending: str) -> None:
    beside = path.with_name(path.name + ending)
    beside.unlink(missing_ok=True)
    for make in (os.mkfifo, lambda p: p.symlink_to("/dev/zero")):
        make(beside)
        with pytest.raises(StoreError, match="cannot be read: it is not a regular file"):
            SqliteStore(path)
        beside.unlink()


def test_a_database_that_dies_while_it_is_made_is_made_again(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    for ending in ("", "-journal", "-wal"):
        path.with_name(f"state.db.new{ending}").write_bytes(b"half")
    assert content(path) == {}
    assert os.listdir(tmp_path) == ["state.db"]


def test_no_room_for_a_new_database(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", "64k") as disk:
        script = "import sys; from colony.runtime.store.sqlite import SqliteStore; SqliteStore(sys.argv[1])"
        command = [*disk.inside, sys.executable, "-c", script, str(disk.path / "state.db")]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        disk.fill()
        ran = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
        assert "database or disk is full" in ran.stderr.splitlines()[-1]
        assert os.listdir(disk.seen) == ["filler"]
        disk.clear()
        subprocess.run(command, env=environment, check=True, timeout=60)
        assert "state.db" in os.listdir(disk.seen)


# --- what is damaged -----------------------------------------------------------------------------


def test_a_file_cut_short_is_kept_aside(path: Path) -> None:
    whole = path.read_bytes()
    sizes = (0, 1, 50, 100, 1024, 3000, len(whole) // 2, len(whole) - 1)
    for number, size in enumerate(sizes, 1):
        path.write_bytes(whole[:size])
        found, said = after_damage(path)
        assert found == {}
        (line,) = said
        assert line.startswith(f"{path} is damaged: ")
        assert line.endswith(f"it is kept as state.db.damaged-{number}, and DServer starts empty")
        assert path.with_name(f"state.db.damaged-{number}").read_bytes() == whole[:size]
        assert len(damage_notes(path)) == number
        assert after_damage(path) == ({}, []), "the new one is whole"
    list_quarantined(path)[2].unlink()
    assert len(damage_notes(path)) == len(sizes) - 1


def after_damage(path: Path) -> tuple[dict[Key, bytes], list[str]]:
    """What a server finds that is started now, and what it says."""
    said: list[str] = []
    store = SqliteStore(path, report=said.append)
    try:
        return dict(store.load()), said
    finally:
        store.close()


def test_what_is_loaded_of_a_damaged_file_is_right_or_all_of_it_is_kept_aside(path: Path) -> None:
    whole, expected = path.read_bytes(), content(path)
    draw, aside, refused = random.Random(1), 0, 0
    for _ in range(60):
        damaged = bytearray(whole)
        length = draw.choice((1, 4, 1024))
        first = draw.randrange(len(whole) - length)
        damaged[first : first + length] = draw.randbytes(length)
        path.write_bytes(damaged)
        try:
            found, said = after_damage(path)
        except StoreError:  # the damage was in the name of the owner, or in the version
            refused += 1
            continue
        if said:
            assert found == {}
            aside += 1
        else:
            assert found == expected
        assert len(list_quarantined(path)) == aside
    assert aside > 30
    assert refused < 10


def test_text_is_kept_aside_byte_for_byte(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    path.write_bytes(b"remember the milk\n" * 1000)
    assert after_damage(path)[0] == {}
    (aside,) = list_quarantined(path)
    assert aside.read_bytes() == b"remember the milk\n" * 1000


def test_a_database_without_a_table_is_kept_aside(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    other = sqlite3.connect(path)
    other.execute("VACUUM")
    other.close()
    assert path.stat().st_size > 0
    found, said = after_damage(path)
    assert (found, len(said)) == ({}, 1)


@pytest.mark.parametrize("left", [None, b""], ids=["no database", "an empty one"])
def test_a_log_without_its_database_is_kept_aside(tmp_path: Path, left: bytes | None) -> None:
    path, copy = tmp_path / "state.db", tmp_path / "copy.db"
    store = SqliteStore(path)
    store.commit({X: b"1"})
    log = (tmp_path / "state.db-wal").read_bytes()
    whole = path.read_bytes()
    store.close()
    (tmp_path / "copy.db-wal").write_bytes(log)
    if left is not None:
        copy.write_bytes(left)
    found, said = after_damage(copy)
    assert (found, len(said)) == ({}, 1)
    assert (tmp_path / "copy.db.damaged-1-wal").read_bytes() == log
    (line,) = damage_notes(copy)
    there = "copy.db.damaged-1-wal" if left is None else "copy.db.damaged-1"
    assert line.endswith(f"; remove {tmp_path / there} when it is not needed")
    (tmp_path / "copy.db.damaged-1").write_bytes(whole)
    assert content(tmp_path / "copy.db.damaged-1") == {X: b"1"}, "both together can be read again"


def test_nothing_is_overwritten_by_what_is_kept_aside(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    path.write_bytes(b"")
    (tmp_path / "state.db.damaged-1-wal").write_bytes(b"of another one")
    after_damage(path)
    assert {p.name for p in tmp_path.iterdir()} == {
        "state.db",
        "state.db.damaged-1-wal",
        "state.db.damaged-2",
    }


def test_a_damaged_file_that_another_server_has_open_stays_where_it_is(path: Path) -> None:
    script = (
        "import sys; from colony.runtime.store.sqlite import SqliteStore; "
        "store = SqliteStore(sys.argv[1]); print('open', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout.readline() == "open\n"
        os.truncate(path, 0)
        assert "in use" in refusal(path)
        assert path.exists()
        assert list_quarantined(path) == ()
        other.communicate()


def test_a_store_has_one_server(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    store = SqliteStore(path)
    with pytest.raises(StoreError, match="in use"):
        SqliteStore(path, lock_timeout_s=0.0)
    store.commit({X: b"1"})
    store.close()
    with pytest.raises(StoreError, match="is closed"):
        store.commit({X: b"2"})


def test_a_commit_that_cannot_be_done_is_told_and_undone(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    store = SqliteStore(path)
    store.commit({X: b"1"})
    pages = store._database.execute("PRAGMA page_count").fetchone()[0]
    store._database.execute(f"PRAGMA max_page_count = {pages + 5}")
    with pytest.raises(StoreError, match="full"):
        store.commit({X: b"2", Y: b"2" * 100_000})
    assert dict(store.load()) == {X: b"1"}
    store.close()
    reopened = SqliteStore(path)
    assert dict(reopened.load()) == {X: b"1"}
    reopened.close()
