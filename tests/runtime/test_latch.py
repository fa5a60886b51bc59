"""The emergency stop outlives every process that knows of it, until the Clock releases it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from colony.runtime.latch import StopFollower, StopLatch
from colony.runtime.messages import Stopped, Tick

ANN = Stopped(by="ann/1", t_ns=5)
HUGE = b'{"stopped": {"by": "ann/1", "t_ns": 99999999999999999999999}, "released_ns": 0}'


def test_a_stop_is_there_after_a_restart_until_it_is_released(tmp_path: Path) -> None:
    path = tmp_path / "stop"
    assert StopLatch(path).stopped is None
    StopLatch(path).engage(ANN)
    again = StopLatch(path)
    assert again.stopped == ANN
    again.release(9)
    last = StopLatch(path)
    assert (last.stopped, last.released_ns) == (None, 9)
    assert os.listdir(tmp_path) == ["stop"]


def test_the_first_stop_is_the_one_that_is_remembered(tmp_path: Path) -> None:
    latch = StopLatch(tmp_path / "stop")
    latch.engage(ANN)
    latch.engage(Stopped(by="bob/1", t_ns=6))
    assert latch.stopped == ANN


def test_without_a_file_it_holds_in_memory() -> None:
    latch = StopLatch(None)
    latch.engage(ANN)
    assert latch.stopped is not None
    latch.release(6)
    assert latch.stopped is None


def test_a_stop_that_only_a_server_heard_is_latched_and_one_that_is_over_is_not(tmp_path: Path) -> None:
    latch = StopLatch(tmp_path / "stop")
    latch.release(4)
    latch.observe(Stopped(by="old/1", t_ns=4))
    assert latch.stopped is None
    latch.observe(ANN)
    assert StopLatch(tmp_path / "stop").stopped == ANN


@pytest.mark.parametrize(
    "data",
    [b"", b"{", b"\xff\xfe", b"[1]", b"null", b'{"by": 3, "t_ns": 0}', b'{"by": "ann/1", "t_ns": 0}', HUGE],
)
def test_a_file_that_cannot_be_read_counts_as_a_stop(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "stop"
    path.write_bytes(data)
    latch = StopLatch(path)
    assert latch.stopped is not None
    assert str(path) in (latch.trouble or "")
    latch.release(1)
    assert latch.trouble is None
    assert StopLatch(path).stopped is None


def test_what_could_not_be_written_holds_and_is_written_when_it_can_be(tmp_path: Path) -> None:
    path = tmp_path / "not there yet" / "stop"
    latch = StopLatch(path)
    latch.engage(ANN)
    assert latch.stopped is not None
    assert "No such file or directory" in (latch.trouble or "")
    path.parent.mkdir()
    latch.save()
    assert latch.trouble is None
    assert StopLatch(path).stopped == ANN


def test_a_server_stops_by_its_own_ears_and_goes_on_by_a_later_release() -> None:
    server = StopFollower()
    server.follow(Tick(k=1, t_ns=0, released_ns=4))
    assert server.stopped is None
    server.hear(ANN)
    server.follow(Tick(k=2, t_ns=0, released_ns=4))
    assert server.stopped == ANN, "the release was before the stop"
    server.hear(Stopped(by="bob/1", t_ns=8))
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
