"""The position of a page in a run: no clock, no sockets."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Iterator

import pytest

from colony.runtime.recordings.reader import LinesReader
from colony.watch import store as store_module
from colony.watch.snapshot import FrameMark
from colony.watch.sources import RecordingSource
from colony.watch.store import FrameRange, SnapshotStore, history_to, path_to, timeline_of
from colony.watch.trail import RunTrail
from colony.watch.viewer import Player
from tests.waiting import until
from tests.watch.runs import FRAMES, PROGRAM, scene, snapshots


def filled(**options: int) -> SnapshotStore:
    store = SnapshotStore(scene().modules, **options)
    for snapshot in snapshots():
        store.add(snapshot)
    return store


@pytest.fixture
def store() -> Iterator[SnapshotStore]:
    store = filled()
    store.is_complete = True
    yield store
    store.close()


def test_it_plays_at_a_speed_to_the_end(store: SnapshotStore) -> None:
    player = Player(store, follows=False)
    assert player.index(100.0) == 0
    player.play(100.0, 2.0)
    assert [player.index(100.0 + x) for x in (0.0, 0.24, 0.25, 0.5, 3.0)] == [0, 4, 5, 10, FRAMES - 1]
    assert not player.is_playing
    player.play(200.0, 1.0)
    assert player.index(200.0) == 0


def test_it_waits_at_the_end_of_what_is_there_and_goes_on() -> None:
    store = SnapshotStore(scene().modules)
    player = Player(store, follows=False)
    assert player.index(0.0) is None
    for snapshot in snapshots()[:5]:
        store.add(snapshot)
    assert player.index(10.0) == 0
    assert player.index(20.0) == 4
    for snapshot in snapshots()[5:]:
        store.add(snapshot)
    assert [player.index(20.0 + x) for x in (0.0, 0.1, 0.25)] == [4, 5, 6]
    store.close()


def test_a_recording_without_frames_says_so() -> None:
    store = SnapshotStore(scene().modules)
    with RecordingSource(LinesReader(io.BytesIO(b""), "run.jsonl"), PROGRAM, store, RunTrail(PROGRAM)):
        until(lambda: store.is_complete, "the recording is read")
    assert store.problem == "it contains no frame"
    store.close()


def test_a_disk_that_becomes_full_keeps_no_part_of_a_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    store = SnapshotStore(scene().modules)
    first, second, *_ = snapshots()
    store.add(first)
    write, room = os.pwrite, [20]

    def pwrite(descriptor: int, data: bytes, offset: int) -> int:
        if not room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(descriptor, data[: room.pop()], offset)

    monkeypatch.setattr(os, "pwrite", pwrite)
    with pytest.raises(OSError, match="No space left"):
        store.add(second)
    assert store.span == FrameRange(0, 1)
    store.close()


def test_it_follows_the_newest_until_it_is_paused(store: SnapshotStore) -> None:
    player = Player(store, follows=True)
    assert player.index(0.0) == FRAMES - 1
    player.step(0.0, -3)
    assert [player.index(x) for x in (0.0, 9.0)] == [FRAMES - 4] * 2
    player.follow()
    assert player.index(9.0) == FRAMES - 1


def test_it_jumps_to_what_begins(store: SnapshotStore) -> None:
    player = Player(store, follows=False)
    player.seek(0.0, 0.0)
    found = []
    while player.jump(0.0, FrameMark.WINNER, backward=False):
        found.append(player.index(0.0))
    assert found == [3, 5, 9, 15]
    assert player.jump(0.0, FrameMark.LATE, backward=True)
    assert player.index(0.0) == 8
    assert not player.jump(0.0, FrameMark.FAULT, backward=True)


def test_seeking_before_and_after_the_run(store: SnapshotStore) -> None:
    player = Player(store, follows=False)
    for t, expected in ((-5.0, 0), (0.55, 5), (1e9, FRAMES - 1)):
        player.seek(0.0, t)
        player.pause()
        assert player.index(1.0) == expected


def test_a_limited_store_drops_its_oldest_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_module, "SEGMENT_FRAMES", 4)
    store = filled(max_bytes=1)
    assert store.span == FrameRange(12, FRAMES)
    assert store.read(0) == store.read(12)
    assert store.index_at(0.0) == 12
    player = Player(store, follows=False)
    assert player.index(0.0) == 12
    store.close()


def test_timeline_path_and_history(store: SnapshotStore) -> None:
    timeline = timeline_of(store)
    assert (timeline.first, timeline.last, timeline.is_complete) == (0.0, pytest.approx(1.9), True)
    assert timeline.winners[3:6] == (1, 1, -1)
    assert timeline.marks[15] == FrameMark.WINNER | FrameMark.BREACH
    assert path_to(store, 3) == [(0.0, 0.0), (100.0, 0.0), (200.0, 0.0), (200.0, 0.0)]
    assert [bytes(raw) for raw in history_to(store, 2)] == [store.read(0), store.read(1)]
