"""The emergency stop at the Clock: kept, repeated in every tick, learned from others, released here alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from colony.runtime.arbitration.stop_latch import FILE_BYTES
from colony.runtime.frames.clock import Clock
from colony.runtime.library import clock as clock_library
from colony.runtime.library import emergency
from colony.runtime.protocol.codec import check_plausible
from colony.runtime.protocol.messages import ServerFrame, Stopped, Tick, Wake, WakeAt
from tests.kit.calling import call_of
from tests.kit.clock import Leader, Stage
from tests.kit.node_stage import MS, Caller, S


@pytest.fixture
def stage() -> Stage:
    return Stage()


def last(stage: Stage) -> Tick:
    """The newest tick, after some frames."""
    stage.pass_time(200 * MS)
    return stage.ticks[-1]


def test_every_tick_repeats_a_stop_until_it_is_released(stage: Stage) -> None:
    ann = Leader(stage, "ann/1")
    assert (last(stage).stopped, last(stage).released_ns) == (None, -1)
    stopped_ns = stage.now_ns
    assert ann.ask(emergency.stop()).problem is None
    stop = Stopped(by="ann/1", t_ns=stopped_ns)
    assert last(stage).stopped == last(stage).stopped == stop
    assert ann.who().stopped == stop
    ann.alive()
    released_ns = stage.now_ns
    assert ann.ask(clock_library.release()).problem is None
    tick = last(stage)
    assert (tick.stopped, tick.released_ns) == (None, released_ns)


@pytest.mark.parametrize(("answers", "at_ms"), [("at once", 50), ("a frame late", 100), ("never", 150)])
def test_a_release_is_answered_once_all_servers_that_answer_ticks_know_it(
    stage: Stage, answers: str, at_ms: int
) -> None:
    ann = Leader(stage, "ann/1")
    ann.ask(emergency.stop())
    last(stage)
    ann.alive()
    stage.handle(Wake())
    ann.begin(clock_library.release())
    released_ns = stage.now_ns
    while ("ann/1", ann.number) not in stage.replies:
        stage.until(stage.now_ns + 10 * MS, answering=() if answers != "at once" else ("PServer", "RServer"))
        if answers == "a frame late":
            k = stage.ticks[-2].k
            stage.handle(*(ServerFrame(server=server, k=k, fields={}) for server in ("PServer", "RServer")))
    assert abs(stage.now_ns - released_ns - at_ms * MS) <= 10 * MS


def test_an_earlier_frame_that_a_server_sends_again_delays_no_release(stage: Stage) -> None:
    ann = Leader(stage, "ann/1")
    ann.ask(emergency.stop())
    last(stage)
    ann.alive()
    ann.begin(clock_library.release())
    count = len(stage.ticks)
    while len(stage.ticks) == count:
        stage.until(stage.now_ns + 10 * MS, answering=("PServer",))
    k = stage.ticks[-1].k
    stage.handle(ServerFrame(server="PServer", k=k - 1, fields={}))
    assert ("ann/1", ann.number) not in stage.replies
    stage.handle(ServerFrame(server="RServer", k=k, fields={}))
    assert ("ann/1", ann.number) in stage.replies


def test_a_stop_needs_no_connection_and_more_than_the_right_to_read(stage: Stage) -> None:
    nobody = Caller(stage, "nobody/1")
    assert nobody.refusal(emergency.stop()._replace(right="read")) == "right"
    assert last(stage).stopped is None
    nobody.do(emergency.stop())
    assert last(stage).stopped is not None
    assert nobody.refusal(clock_library.release()), "to release, somebody is known by a connection"
    assert last(stage).stopped is not None


def test_a_stop_that_only_a_server_heard_is_latched(stage: Stage) -> None:
    ann = Leader(stage, "ann/1")
    stop = Stopped(by="bob/1", t_ns=stage.now_ns)
    k = last(stage).k
    stage.handle(ServerFrame(server="RServer", k=k, fields={}, stopped=stop))
    assert last(stage).stopped == stop
    ann.alive()
    ann.ask(clock_library.release())
    stage.handle(ServerFrame(server="RServer", k=k + 1, fields={}, stopped=stop))
    assert last(stage).stopped is None, "that stop is over"


def started(path: Path) -> list[Any]:
    return list(Clock(servers=(), frames_kept=4, stop_path=path).start(5 * S))


def test_a_clock_that_is_started_again_knows_of_the_stop(tmp_path: Path) -> None:
    path = tmp_path / "stop"
    first = Clock(servers=(), frames_kept=4, stop_path=path)
    list(first.start(1 * S))
    first._stop("ann/1", 3 * S)
    (tick,) = (e.message for e in started(path) if not isinstance(e, WakeAt))
    assert tick.stopped == Stopped(by="ann/1", t_ns=3 * S)
    first._latch.release(4 * S)
    (tick,) = (e.message for e in started(path) if not isinstance(e, WakeAt))
    assert (tick.stopped, tick.released_ns) == (None, 4 * S)


def test_times_of_another_clock_are_not_believed(tmp_path: Path) -> None:
    """The robot's time began at 0 once more; a release of the future would undo every stop until then."""
    path = tmp_path / "stop"
    first = Clock(servers=(), frames_kept=4, stop_path=path)
    first._latch.release(1000 * S)
    (tick,) = (e.message for e in started(path) if not isinstance(e, WakeAt))
    assert (tick.stopped, tick.released_ns) == (None, -1)
    check_plausible(tick, 5 * S)
    first._stop("ann/1", 2000 * S)
    (tick,) = (e.message for e in started(path) if not isinstance(e, WakeAt))
    assert tick.stopped == Stopped(by="ann/1", t_ns=5 * S)
    check_plausible(tick, 5 * S)


def test_a_stop_that_cannot_be_kept_stops_and_says_so(tmp_path: Path) -> None:
    stage = Stage(stop_path=tmp_path / "no folder" / "stop")
    ann = Leader(stage, "ann/1")
    problem = ann.ask(emergency.stop()).problem
    assert problem.code == "not kept"
    assert "No such file or directory" in problem.message
    assert last(stage).stopped is not None
    ann.alive()
    assert "No such file" in (ann.who().trouble or "")
    (tmp_path / "no folder").mkdir()
    for _ in range(6):
        last(stage)
        ann.alive()
    assert ann.who().trouble is None, "kept within a second of when it can be"
    assert (tmp_path / "no folder" / "stop").stat().st_size == FILE_BYTES


def test_a_stop_that_was_not_kept_is_no_second_stop_when_it_arrives_again(tmp_path: Path) -> None:
    stage = Stage(stop_path=tmp_path / "no folder" / "stop")
    ann = Leader(stage, "ann/1")
    first = ann.ask(emergency.stop())
    ann.ask(clock_library.release())
    assert last(stage).stopped is None
    stage.handle(call_of(emergency.stop(), "ann/1", first.number))
    assert stage.effects[-1].message == first
    assert last(stage).stopped is None


def test_the_clock_numbers_on_above_a_frame_that_somebody_else_invented(stage: Stage) -> None:
    before = last(stage)
    stage.handle(ServerFrame(server="RServer", k=before.k + 1000, fields={}))
    after = last(stage)
    assert after.k > before.k + 1000
    assert after.start > before.k + 1000, "memory begins anew: the frames between never were"
    assert last(stage).start == after.start, "once"
