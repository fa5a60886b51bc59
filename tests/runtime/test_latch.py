"""The emergency stop outlives its server."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from colony.runtime.latch import StopLatch
from colony.runtime.library.robot import Stopped


def test_a_stop_is_there_after_a_restart_until_it_is_released(tmp_path: Path) -> None:
    path = tmp_path / "stop"
    assert StopLatch(path).stopped is None
    StopLatch(path).engage("ann/1", 5)
    again = StopLatch(path)
    assert again.stopped == Stopped(by="ann/1", t_ns=5)
    again.release()
    assert StopLatch(path).stopped is None
    assert os.listdir(tmp_path) == ["stop"]


def test_who_stopped_first_is_remembered(tmp_path: Path) -> None:
    latch = StopLatch(tmp_path / "stop")
    latch.engage("ann/1", 5)
    latch.engage("bob/1", 6)
    assert latch.stopped == Stopped(by="ann/1", t_ns=5)


def test_without_a_file_it_holds_in_memory() -> None:
    latch = StopLatch(None)
    latch.engage("ann/1", 5)
    assert latch.stopped is not None
    latch.release()
    assert latch.stopped is None


@pytest.mark.parametrize("data", [b"", b"{", b"\xff\xfe", b"[1]", b'{"by": 3, "t_ns": 0}'])
def test_a_file_that_cannot_be_read_counts_as_a_stop(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "stop"
    path.write_bytes(data)
    latch = StopLatch(path)
    assert latch.stopped is not None
    assert str(path) in (latch.trouble or "")
    latch.release()
    assert latch.trouble is None
    assert StopLatch(path).stopped is None


def test_what_could_not_be_written_holds_and_is_written_when_it_can_be(tmp_path: Path) -> None:
    path = tmp_path / "not there yet" / "stop"
    latch = StopLatch(path)
    latch.engage("ann/1", 5)
    assert latch.stopped is not None
    assert "No such file or directory" in (latch.trouble or "")
    path.parent.mkdir()
    latch.save()
    assert latch.trouble is None
    assert StopLatch(path).stopped == Stopped(by="ann/1", t_ns=5)
