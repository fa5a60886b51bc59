"""The emergency stop outlives every process that knows of it, until the Clock releases it."""

from __future__ import annotations

import errno
import os
import resource
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from zlib import crc32

import pytest

from colony.files import open_descriptor
from colony.runtime.arbitration import stop_latch
from colony.runtime.arbitration.stop_latch import (
    FILE_BYTES,
    MAX_AUTHOR_LENGTH,
    UNREADABLE,
    StopFollower,
    StopLatch,
)
from colony.runtime.protocol.messages import Stopped, Tick
from tests.kit.node_stage import MS

ANN = Stopped(by="ann/1", t_ns=5)
BOB = Stopped(by="bob/1", t_ns=6)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "stop"


def begun(path: Path | None, now_ns: int = 100) -> StopLatch:
    """The latch of a Clock that is started."""
    latch = StopLatch(path)
    latch.begin(now_ns)
    return latch


@pytest.fixture
def latch(path: Path) -> StopLatch:
    return begun(path)


def found(path: Path) -> Stopped | None:
    """The stop that a Clock which is started again knows of."""
    latch = begun(path)
    latch.close()
    return latch.stopped


def test_a_stop_is_there_after_a_restart_until_it_is_released(path: Path) -> None:
    assert begun(path).stopped is None
    begun(path).engage(ANN)
    again = begun(path)
    assert again.stopped == ANN
    again.release(9)
    last = begun(path)
    assert (last.stopped, last.released_ns, last.trouble) == (None, 9, None)
    assert os.listdir(path.parent) == ["stop"]


def test_the_first_stop_is_the_one_that_is_remembered(latch: StopLatch, path: Path) -> None:
    latch.engage(ANN)
    latch.engage(BOB)
    assert latch.stopped == found(path) == ANN


def test_without_a_file_it_holds_in_memory() -> None:
    latch = begun(None)
    latch.engage(ANN)
    assert latch.stopped is not None
    latch.save(7)
    latch.release(6)
    latch.close()
    assert (latch.stopped, latch.trouble) == (None, None)


def test_a_stop_that_only_a_server_heard_is_latched_and_one_that_is_over_is_not(
    latch: StopLatch, path: Path
) -> None:
    latch.release(4)
    latch.observe(Stopped(by="old/1", t_ns=4))
    assert latch.stopped is None
    latch.observe(ANN)
    assert found(path) == ANN


def test_the_room_is_taken_when_the_clock_starts_and_stays_the_same(latch: StopLatch, path: Path) -> None:
    room = (path.stat().st_size, path.stat().st_blocks * 512, path.stat().st_ino)
    assert room[0] == FILE_BYTES
    assert room[1] >= FILE_BYTES
    latch.engage(Stopped(by="\0" * 1000, t_ns=5))
    assert (path.stat().st_size, path.stat().st_blocks * 512, path.stat().st_ino) == room
    assert found(path) == Stopped(by="\0" * MAX_AUTHOR_LENGTH, t_ns=5)
    latch.release(2**63 - 1)
    assert begun(path, 2**63 - 1).released_ns == 2**63 - 1


# --- files that cannot be read ---------------------------------------------------------------------


def of_a_clock(body: bytes) -> bytes:
    """The content of a file with the right checksum."""
    body = body.ljust(FILE_BYTES - 24) + b"\n"
    return b"colony stop 1 %08x %s" % (crc32(body), body)


def kept(path: Path) -> bytes:
    """The content of a file that says "released"."""
    begun(path).release(3)
    return path.read_bytes()


BAD: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda good: b"",
    "zeros": lambda good: bytes(FILE_BYTES),
    "cut short": lambda good: good[:-1],
    "too long": lambda good: good + b"\n",
    "no file of a Clock": lambda good: b"x" * FILE_BYTES,
    "a later version": lambda good: good.replace(b"stop 1", b"stop 2"),
    "a wrong checksum": lambda good: good.replace(b'released_ns":3', b'released_ns":4'),
    "torn": lambda good: good[:512] + bytes(FILE_BYTES - 512),
    "no text": lambda good: of_a_clock(b"\xff\xfe"),
    "not JSON": lambda good: of_a_clock(b"{"),
    "another type": lambda good: of_a_clock(b"null"),
    "a time beyond all times": lambda good: of_a_clock(b'{"stopped":null,"released_ns":%d}' % 10**23),
    "the former form": lambda good: b'{"stopped":null,"released_ns":3}',
}


@pytest.mark.parametrize("kind", BAD)
def test_a_file_that_cannot_be_read_counts_as_a_stop(path: Path, kind: str) -> None:
    good = kept(path)
    assert found(path) is None
    bad = BAD[kind](good)
    path.write_bytes(bad)
    said: list[str] = []
    latch = StopLatch(path, report=said.append)
    latch.begin(0)
    assert latch.stopped == Stopped(by=UNREADABLE, t_ns=0)
    (line,) = said
    assert line == f"stopped until released, because the stop file cannot be read: {latch.trouble}"
    assert (latch.trouble or "").startswith(f"{path}: ")
    latch.save(10**12)
    assert path.read_bytes() == bad, "it is left as it is until somebody stops or releases the robot"
    latch.release(1)
    assert latch.trouble is None
    assert found(path) is None


REASONS = {
    "empty": "it is empty",
    "cut short": "no Clock of this version wrote it",
    "too long": "it is larger than 4 KiB",
    "a later version": "no Clock of this version wrote it",
    "a wrong checksum": "it is damaged: the checksum is wrong",
    "not JSON": "Input data was truncated",
}


@pytest.mark.parametrize("kind", REASONS)
def test_it_is_told_why_a_file_cannot_be_read(path: Path, kind: str) -> None:
    path.write_bytes(BAD[kind](kept(path)))
    latch = begun(path)
    assert latch.stopped == Stopped(by="a file that cannot be read", t_ns=0)
    assert latch.trouble == f"{path}: {REASONS[kind]}"


def test_any_byte_of_the_file_counts(path: Path) -> None:
    good = kept(path)
    for place in range(0, FILE_BYTES, 7):
        path.write_bytes(good[:place] + bytes([good[place] ^ 1]) + good[place + 1 :])
        assert found(path) is not None, place


@pytest.fixture(params=["a pipe", "a folder", "a socket", "a device", "a file elsewhere", "nothing"])
def strange(request: pytest.FixtureRequest, path: Path) -> Iterator[Path]:
    """What is no regular file, in the place of the file; the last three by a link."""
    with socket.socket(socket.AF_UNIX) as listener:
        match request.param:
            case "a pipe":
                os.mkfifo(path)
            case "a folder":
                path.mkdir()
            case "a socket":
                listener.bind(str(path))
            case "a device":
                path.symlink_to("/dev/zero")
            case "a file elsewhere":
                kept(path.with_name("elsewhere"))
                path.symlink_to(path.with_name("elsewhere"))
            case "nothing":
                path.symlink_to(path.with_name("nothing"))
        yield path


def test_what_is_no_regular_file_counts_as_a_stop_and_keeps_none(strange: Path) -> None:
    latch = begun(strange)
    assert latch.stopped == Stopped(by=UNREADABLE, t_ns=0)
    latch.engage(ANN)
    assert (latch.trouble or "").startswith(f"{strange}: ")
    latch.release(1)
    assert latch.stopped is None
    assert (latch.trouble or "").startswith(f"{strange}: ")
    assert found(strange) is not None


def test_a_file_that_was_being_replaced_counts_as_a_stop(path: Path) -> None:
    path.with_name("stop.new").write_bytes(b"")
    latch = begun(path)
    assert latch.stopped is not None
    assert "stop.new was left over" in (latch.trouble or "")
    assert not path.exists()
    latch.release(1)
    assert os.listdir(path.parent) == ["stop"]
    assert found(path) is None


# --- files that cannot be written, or go away ------------------------------------------------------


def test_what_is_left_beside_a_file_in_use_is_gone_with_the_next_release(
    latch: StopLatch, path: Path
) -> None:
    path.with_name("stop.new").touch()
    latch.engage(Stopped(by="ann", t_ns=200))
    latch.release(300)
    latch.close()
    assert found(path) is None


def test_what_could_not_be_written_holds_and_is_written_when_it_can_be(tmp_path: Path) -> None:
    path = tmp_path / "not there yet" / "stop"
    said: list[str] = []
    latch = StopLatch(path, report=said.append)
    latch.begin(0)
    latch.engage(ANN)
    assert latch.stopped is not None
    assert latch.trouble == f"{path}: No such file or directory"
    assert said == [f"an emergency stop cannot be saved: {latch.trouble}"], "once"
    path.parent.mkdir()
    latch.save(0)
    assert latch.trouble is None
    assert found(path) == ANN


def test_a_file_that_cannot_be_written_is_tried_again_after_longer_and_longer_pauses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    latch = begun(tmp_path / "none" / "stop")
    tried: list[int] = []
    for now_ns in range(0, 10_000 * MS, 10 * MS):
        monkeypatch.setattr(latch, "_write", lambda now_ns=now_ns: tried.append(now_ns // MS))
        latch.save(now_ns)
    assert tried == [0, 50, 150, 350, 750, 1550, *range(2550, 10_000, 1000)]
    monkeypatch.undo()
    (tmp_path / "none").mkdir()
    latch.engage(ANN)
    assert latch.trouble is None, "a call does not wait"


@pytest.mark.parametrize("by", [None, b"something else"], ids=["nothing", "another file"])
def test_a_file_that_went_away_is_made_again(latch: StopLatch, path: Path, by: bytes | None) -> None:
    latch.engage(ANN)
    for keep in (lambda: latch.engage(BOB), lambda: latch.save(10**12)):
        path.rename(path.with_name("away"))
        if by is not None:
            path.write_bytes(by)
        keep()
        assert latch.trouble is None
        assert found(path) == ANN
    path.unlink()
    latch.release(8)
    assert (begun(path).stopped, begun(path).released_ns) == (None, 8)


def test_a_folder_that_went_away_is_told(tmp_path: Path) -> None:
    path = tmp_path / "state" / "stop"
    path.parent.mkdir()
    latch = begun(path)
    path.parent.rename(tmp_path / "away")
    latch.engage(ANN)
    assert latch.trouble == f"{path}: No such file or directory"
    (tmp_path / "away").rename(path.parent)
    latch.save(0)
    assert latch.trouble is None
    assert found(path) == ANN


def test_a_file_that_is_moved_away_while_it_is_written_keeps_nothing(
    latch: StopLatch, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = os.fdatasync

    def moved(descriptor: int) -> None:
        written(descriptor)
        path.rename(path.with_name("away"))

    monkeypatch.setattr(os, "fdatasync", moved)
    latch.engage(ANN)
    assert latch.trouble == f"{path}: it was moved while it was being written"
    monkeypatch.undo()
    latch.save(0)
    assert latch.trouble is None
    assert found(path) == ANN


def test_a_file_that_cannot_be_made_whole_is_not_left_behind(path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_BYTES // 2, before[1]))
    try:
        latch = begun(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert latch.trouble == f"{path}: No space left on device"
    assert not path.exists(), "a Clock that is started again is not stopped by it"
    latch.save(0)
    assert latch.trouble is None


def test_of_a_file_that_cannot_be_made_whole_and_goes_away_the_first_problem_is_told(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int, data: bytes, offset: int) -> int:
        path.unlink()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "pwrite", full)
    assert begun(path).trouble == f"{path}: No space left on device"
    assert not path.exists()


@pytest.mark.parametrize("is_link", [True, False], ids=["a link", "a file"])
def test_what_appears_where_the_file_is_to_be_made_is_not_written(
    path: Path, monkeypatch: pytest.MonkeyPatch, is_link: bool
) -> None:
    """Between the look for the file and its making another process may put something there."""
    other = path.with_name("other")

    def late(where: Path, flags: int) -> int:
        if flags & os.O_CREAT:
            _ = path.symlink_to(other) if is_link else path.write_bytes(b"another's")
        return open_descriptor(where, flags)

    monkeypatch.setattr(stop_latch, "open_descriptor", late)
    assert begun(path).trouble == f"{path}: {'it is not a regular file' if is_link else 'File exists'}"
    assert not other.exists()
    assert is_link or path.read_bytes() == b"another's"


def test_a_file_that_is_up_to_date_is_not_written_again(latch: StopLatch, path: Path) -> None:
    latch.engage(ANN)
    os.utime(path, ns=(0, 0))
    latch.save(10**12)
    assert path.stat().st_mtime_ns == 0


def test_each_stop_that_is_acknowledged_is_written(latch: StopLatch, path: Path) -> None:
    latch.engage(ANN)
    os.utime(path, ns=(0, 0))
    latch.engage(BOB)
    assert path.stat().st_mtime_ns != 0
    assert found(path) == ANN


@pytest.mark.parametrize("other", ["a backup", "a part of it", "more", "nothing"])
def test_a_file_that_was_written_over_in_place_has_the_stop_again(
    latch: StopLatch, path: Path, other: str
) -> None:
    backup = path.read_bytes()
    latch.engage(ANN)
    good, place = path.read_bytes(), path.stat().st_ino
    content = {"a backup": backup, "a part of it": good[:-1], "more": good + b"\n", "nothing": b""}[other]
    for keep in (lambda: latch.engage(BOB), lambda: latch.save(10**12)):
        path.write_bytes(content)
        keep()
        assert latch.trouble is None
        assert path.read_bytes() == good
        assert path.stat().st_ino == place


def test_times_of_a_clock_from_before_the_machine_was_started_are_not_believed(path: Path) -> None:
    begun(path).engage(Stopped(by="ann/1", t_ns=1000))
    for now_ns, t_ns in ((1000, 1000), (999, 999), (2000, 999)):
        assert begun(path, now_ns).stopped == Stopped(by="ann/1", t_ns=t_ns)
    begun(path).release(1000)
    assert begun(path, 1000).released_ns == 1000
    assert begun(path, 999).released_ns == -1


# --- servers ---------------------------------------------------------------------------------------


def test_a_server_stops_by_its_own_ears_and_goes_on_by_a_later_release() -> None:
    server = StopFollower()
    server.follow(Tick(k=1, t_ns=0, released_ns=4))
    assert server.stopped is None
    server.engage(ANN)
    server.follow(Tick(k=2, t_ns=0, released_ns=4))
    assert server.stopped == ANN, "the release was before the stop"
    server.engage(Stopped(by="bob/1", t_ns=8))
    server.follow(Tick(k=3, t_ns=0, released_ns=7))
    assert server.stopped == Stopped(by="ann/1", t_ns=8), "of two stops the later one counts"
    server.follow(Tick(k=4, t_ns=0, released_ns=8))
    assert server.stopped is None


def test_a_server_stops_by_a_tick_also_where_that_tells_of_an_older_release() -> None:
    server = StopFollower()
    server.follow(Tick(k=1, t_ns=0, stopped=ANN, released_ns=2))
    assert server.stopped == ANN
    server.follow(Tick(k=2, t_ns=0, released_ns=5))
    assert server.stopped is None
    server.follow(Tick(k=3, t_ns=0, stopped=Stopped(by="bob/1", t_ns=9), released_ns=5))
    assert server.stopped == Stopped(by="bob/1", t_ns=9)
