"""A store on a disk that gets full: what was begun is kept, all else is refused, and nothing is ever lost."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from colony.runtime.store.store import RESERVE_BYTES, Journal, Key, PendingStore, StoreFullError
from tests.kit.data import Cramped
from tests.kit.node_stage import settle
from tests.paths import ROOT
from tests.small_disk import SmallDisk, small_disk

X, Y, Z = (Key("value", name) for name in "XYZ")


class StoreProcess:
    """A store in a process on a small disk. Mutable: it may be killed and started again."""

    def __init__(self, disk: SmallDisk, *, largest_file: int | None = None) -> None:
        self.disk = disk
        self.file = disk.seen / "state.db"

        def limit() -> None:
            if largest_file is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))

        command = [sys.executable, "-m", "tests.runtime.store.full_disk_child", str(disk.path / "state.db")]
        self.process = subprocess.Popen(
            [*disk.inside, *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            preexec_fn=limit,
        )

    def ask(self, *command: Any) -> dict[str, Any]:
        """What came of a command: its answer, whether the store is full, and what was wrong."""
        self.send(command)
        return self.receive()

    def send(self, *commands: tuple[Any, ...]) -> None:
        self.process.stdin.writelines(json.dumps(command) + "\n" for command in commands)
        self.process.stdin.flush()

    def receive(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.process.stdout.readline())
        return found

    def well(self, *command: Any) -> Any:
        """The answer to a command that is to succeed, in a store that has room."""
        found = self.ask(*command)
        assert (found["problem"], found["full"]) == (None, None)
        return found["answer"]

    def kill(self) -> None:
        with self.process:
            self.process.kill()


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[SmallDisk]:
    with small_disk(tmp_path / "disk", "8m") as made:
        yield made


Start = Callable[..., StoreProcess]


@pytest.fixture
def start(disk: SmallDisk) -> Iterator[Start]:
    """Starts a process with the store; whichever was started is killed in the end."""
    started: list[StoreProcess] = []

    def begin(**options: Any) -> StoreProcess:
        started.append(StoreProcess(disk, **options))
        return started[-1]

    yield begin
    for store in started:
        store.kill()


def until_full(store: StoreProcess, size: int = 5000) -> list[str]:
    """Fill a store; gives the names of what it has kept, the last one after the disk was full."""
    kept: list[str] = []
    while True:
        name = f"N{len(kept):05}"
        found = store.ask("put", name, size)
        assert found["problem"] is None
        kept.append(name)
        if found["full"] is not None:
            assert str(store.disk.path) in found["full"]
            assert "free some space" in found["full"]
            return kept


@pytest.mark.parametrize("answers", [1, 20, 80])
def test_a_store_that_is_killed_at_any_moment_has_all_that_it_answered(start: Start, answers: int) -> None:
    store, names = start(), [f"N{number:03}" for number in range(100)]
    store.well("open")
    store.send(*(("put", name, 5000) for name in names))
    for _ in range(answers):
        assert store.receive()["problem"] is None
    store.kill()
    store = start()
    store.well("open")
    kept = store.well("names")
    assert kept == names[: len(kept)]
    assert len(kept) >= answers


@pytest.mark.parametrize("dies", [False, True], ids=["closed", "killed"])
def test_what_is_begun_when_the_disk_gets_full_is_kept(disk: SmallDisk, start: Start, dies: bool) -> None:
    store = start()
    store.well("open")
    disk.fill()
    kept = until_full(store)
    assert not (disk.seen / "state.db.reserve").exists()
    assert store.ask("names")["answer"] == kept
    if not dies:
        store.ask("close")
    store.kill()
    store = start()
    assert store.ask("open")["problem"] is None
    assert store.ask("names")["answer"] == kept


def test_where_the_reserve_is_used_up_nothing_is_lost(disk: SmallDisk, start: Start) -> None:
    store = start()
    store.well("open")
    disk.fill()
    kept = until_full(store)
    while (found := store.ask("put", f"O{len(kept):05}", 5000))["problem"] is None:
        kept.append(f"O{len(kept):05}")
    assert found["problem"].startswith("StoreFullError: ")
    assert sorted(store.ask("names")["answer"]) == sorted(kept)
    store.kill()
    store = start()
    assert "free some space" in store.ask("open")["full"]
    assert sorted(store.ask("names")["answer"]) == sorted(kept)


def test_a_store_has_room_again_when_its_disk_has(disk: SmallDisk, start: Start) -> None:
    store = start()
    store.well("open")
    disk.fill()
    kept = until_full(store)
    assert store.ask("room")["full"] is not None
    disk.clear()
    store.well("room")
    store.well("put", "again", 1)
    assert store.well("names") == [*kept, "again"]
    assert (disk.seen / "state.db.reserve").stat().st_blocks * 512 >= RESERVE_BYTES
    store.well("close")
    store.kill()
    assert [file.name for file in disk.seen.iterdir()] == ["state.db"]


def test_a_store_of_a_full_disk_can_be_read_and_is_full(disk: SmallDisk, start: Start) -> None:
    store = start()
    store.well("open")
    store.well("put", "X", 1)
    store.kill()
    disk.fill()
    store = start()
    store.well("open")  # the reserve of the one that was killed is still there
    store.well("close")
    store.kill()
    disk.fill()
    store = start()
    assert store.ask("open")["problem"] is None
    assert store.ask("names") == {"answer": ["X"], "full": store.ask("room")["full"], "problem": None}


def test_no_store_can_be_made_on_a_full_disk(disk: SmallDisk, start: Start) -> None:
    disk.fill()
    store = start()
    assert store.ask("open")["problem"].startswith(f"StoreFullError: {disk.path}/state.db: ")
    disk.clear()
    store.well("open")
    store.well("put", "X", 1)


def test_a_limit_of_the_size_of_files_is_like_a_full_disk(disk: SmallDisk, start: Start) -> None:
    store = start(largest_file=RESERVE_BYTES + (1 << 19))
    store.well("open")
    kept: list[str] = []
    while (found := store.ask("put", f"N{len(kept):05}", 50_000))["problem"] is None:
        kept.append(f"N{len(kept):05}")
    assert found["problem"].startswith("StoreFullError: ")
    assert found["full"].endswith(": File too large: raise the limit of file sizes (`ulimit -f`)")
    assert store.ask("names")["answer"] == kept
    store.kill()
    store = start()
    assert store.ask("open")["full"] is None  # this process has no limit
    assert store.well("names") == kept
    store.kill()
    store = start(largest_file=RESERVE_BYTES + (1 << 19))
    assert "File too large" in store.ask("open")["full"]  # though there would be room for the reserve


# --- the journal, and a store that cannot be made ------------------------------------------------


def test_what_nobody_was_promised_waits_for_room() -> None:
    store = Cramped()
    journal = Journal(store)
    store.room = False
    journal.put(X, b"1")
    settle(journal)
    assert journal.full == "no room"
    journal.put(X, b"2")
    journal.put(Y, b"3")
    for _ in range(3):
        settle(journal)
    assert store.commits == 1  # a disk is not asked again and again
    journal.check_space()
    settle(journal)
    assert store.commits == 2
    store.room = True
    journal.check_space()
    assert journal.full is None
    settle(journal)
    assert dict(store.load()) == {X: b"2", Y: b"3"}


def test_what_was_promised_is_kept_or_the_server_ends() -> None:
    store = Cramped()
    journal = Journal(store)
    journal.put(X, b"1")
    journal.mark_ack_pending()
    store.room = False
    with pytest.raises(StoreFullError):
        settle(journal)
    with pytest.raises(StoreFullError):
        settle(journal)
    store.room = True
    settle(journal)
    assert dict(store.load()) == {X: b"1"}
    store.room = False
    journal.put(Y, b"2")
    settle(journal)  # the promise was that of the changes before


def test_a_store_that_cannot_be_made_is_full_until_it_can() -> None:
    made = Cramped()
    made.room = False

    def make() -> Cramped:
        if not made.room:
            raise StoreFullError("no room for a store")
        return made

    store = PendingStore(make, StoreFullError("no room"))
    assert (store.full, list(store.load())) == ("no room", [])
    journal = Journal(store)
    journal.put(X, b"1")
    settle(journal)
    journal.check_space()
    assert journal.full == "no room for a store"
    with pytest.raises(StoreFullError, match="no room for a store"):
        store.commit({Z: b"1"})
    made.room = True
    journal.check_space()
    assert journal.full is None
    settle(journal)
    assert dict(made.load()) == {X: b"1"}
    made.full = "full again"
    assert store.full == "full again"
    journal.check_space()
    assert store.full is None
    store.close()
