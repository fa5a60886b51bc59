"""Frames that go to sinks in a thread of their own: nothing waits for a sink, and nothing of it is lost."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from colony.runtime.observe import observer
from colony.runtime.observe.observer import BackgroundSink
from tests.waiting import until


class Slow:
    """A sink that takes a frame only when it may, and fails at "bad". Mutable: what it took."""

    def __init__(self) -> None:
        self.may = threading.Event()
        self.took: list[Any] = []
        self.closed = False

    def take(self, log: Any) -> None:
        assert self.may.wait(20)
        if log == "bad":
            raise OSError("no room")
        self.took.append(log)

    def close(self) -> None:
        self.closed = True


def test_frames_wait_for_a_slow_sink_and_all_arrive_before_it_is_closed() -> None:
    sink = Slow()
    behind = BackgroundSink(sink)
    for frame in ("a", "b", "c"):
        behind.take(frame)  # type: ignore[arg-type]
    assert sink.took == []
    sink.may.set()
    behind.close()
    assert sink.took == ["a", "b", "c"]
    assert sink.closed


@pytest.mark.parametrize("dispensable", [False, True])
def test_a_sink_that_takes_nothing_holds_no_end_up(
    monkeypatch: pytest.MonkeyPatch, dispensable: bool
) -> None:
    monkeypatch.setattr(observer, "PATIENCE_S", 0.01)
    sink = Slow()
    behind = BackgroundSink(sink, dispensable=dispensable)
    for frame in ("a", "b", "c"):
        behind.take(frame)  # type: ignore[arg-type]
    if dispensable:
        behind.close()
    else:
        with pytest.raises(TimeoutError, match="frames were not recorded"):
            behind.close()
    sink.may.set()


def test_what_a_sink_raises_is_raised_once_and_it_gets_no_more_frames() -> None:
    sink = Slow()
    sink.may.set()
    behind = BackgroundSink(sink)
    behind.take("bad")  # type: ignore[arg-type]
    until(lambda: behind._has_failed, "it fails")
    with pytest.raises(OSError, match="no room"):
        behind.take("a")  # type: ignore[arg-type]
    behind.take("b")  # type: ignore[arg-type]
    behind.close()
    assert sink.took == []
    assert sink.closed


def test_a_sink_that_takes_nothing_ends_the_run_at_last(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(observer, "MAX_WAITING", 3)
    sink = Slow()
    behind = BackgroundSink(sink)
    taken = 0

    def take_all() -> None:
        nonlocal taken
        for taken in range(6):
            behind.take(taken)  # type: ignore[arg-type]

    with pytest.raises(TimeoutError, match="3 frames wait"):
        take_all()
    sink.may.set()
    behind.close()
    assert sink.took == [*range(taken)]
