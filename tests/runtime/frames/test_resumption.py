"""A Clock that is started again goes on with the epoch that others tell of; readers step across the gap."""

from __future__ import annotations

import msgspec
import pytest

from colony.ir.frame import Frame
from colony.runtime.frames.assembler import (
    MAX_REPORTED_NAMES,
    MAX_REPORTED_TICKS,
    READY_INTERVAL_NS,
    FrameAssembler,
    Membership,
)
from colony.runtime.protocol.codec import MAX_GAPS, MessageFormatError, check_plausible
from colony.runtime.protocol.messages import Fetch, Progress, Ready, Restart, SendMessage, ServerFrame, Tick
from tests.kit.clock import CLIENTS, Leader, Stage, deployed
from tests.kit.node_stage import MS, S, messages
from tests.runtime.frames.test_assembler import BUMPER, base, frames, tick


def progress(stepped: int, *ks: int, start: int = 40, **more: object) -> Progress:
    ticks = (Tick(k=k, t_ns=k * 50 * MS, start=start, run="run", **more) for k in ks)  # type: ignore[arg-type]
    return Progress(start=start, stepped=stepped, ticks=tuple(ticks))


def again(*reports: Progress | None, now_ns: int = 10 * S, by: str = CLIENTS[0], **options: object) -> Stage:
    """A Clock that is started while a run is on, with what clients tell it."""
    stage = Stage(deployed(**options), now_ns=now_ns)  # type: ignore[arg-type]
    stage.until(now_ns + 60 * MS)
    for client, report in zip((by, *CLIENTS[1:]), reports, strict=False):
        stage.handle(Ready(client=client, run="run", progress=report))
    stage.ready()
    stage.until(now_ns + 300 * MS)
    return stage


def ours(stage: Stage) -> list[Tick]:
    return [t for t in stage.ticks if t.run == "run"]


# --- the Clock ---------------------------------------------------------------------------------------


def test_it_goes_on_after_the_last_frame_that_anybody_stepped_over() -> None:
    stage = again(progress(60, 59, 60, 61), progress(59, 58, 59, 60))
    first, second = ours(stage)[:2]
    assert (first.start, first.previous, second.start, second.previous) == (40, 60, 40, first.k)
    assert first.k > 61
    assert first.gaps == second.gaps == ((60, first.k),)
    assert first.t_ns > 60 * 50 * MS
    assert not first.restarted


def test_who_is_behind_gets_the_ticks_of_the_clock_before() -> None:
    stage = again(progress(60, 59, 60, 61), progress(58, 57, 58))
    assert [t.k for t in stage.fetched(59)] == [59]
    assert stage.fetched(61) == []
    asked = {fetch.k for fetch in messages(stage.effects, Fetch)}
    stage.pass_time(100 * MS)
    asked |= {fetch.k for fetch in messages(stage.effects, Fetch)}
    assert {59, 60} <= asked


def test_what_was_void_in_an_abandoned_tick_is_still_void() -> None:
    told = progress(60, 59, 60)
    abandoned = msgspec.structs.replace(progress(61, 61, void=(("PServer", 57),)), stepped=60)
    first = ours(again(told, abandoned))[0]
    assert first.void == (("PServer", 57),)


def test_a_clock_that_dies_twice_tells_of_both_gaps() -> None:
    first = ours(again(progress(60, 60, 61, gaps=((50, 55),))))[0]
    assert first.gaps == ((50, 55), (60, first.k))
    assert first.previous == 60


def test_gaps_are_told_as_long_as_anybody_may_be_behind() -> None:
    stage = again(progress(60, 60))
    stage.pass_time(3 * S)
    told = [bool(t.gaps) for t in ours(stage)]
    assert told == sorted(told, reverse=True)
    assert told.count(True) == 40


def test_a_newer_epoch_counts_even_if_only_one_knows_of_it() -> None:
    first = ours(again(progress(60, 60), progress(62, 62, start=61)))[0]
    assert (first.start, first.previous) == (61, 62)


@pytest.mark.parametrize(
    "report",
    [
        progress(39, 40, 41),  # nobody stepped over a frame
        progress(60, 58, 59),  # nobody has the tick
        progress(100_000, 100_000),  # of a time that has not come
    ],
)
def test_what_cannot_go_on_begins_a_new_epoch_and_the_program_knows(report: Progress) -> None:
    first, second = ours(again(report, now_ns=20 * S))[:2]
    assert (first.start, first.gaps, first.restarted) == (first.k, (), True)
    assert not second.restarted


def test_a_fresh_run_was_not_restarted() -> None:
    assert not any(t.restarted for t in ours(again(None)))


def test_after_a_new_epoch_of_a_run_the_program_knows() -> None:
    stage = again(None)
    stage.handle(Restart(client=CLIENTS[0], start=ours(stage)[0].k))
    stage.pass_time(100 * MS)
    assert [t.restarted for t in ours(stage)] == [t.k == t.start and i > 0 for i, t in enumerate(ours(stage))]
    assert any(t.restarted for t in ours(stage))


def test_strangers_tell_nothing_and_the_observer_does() -> None:
    assert not ours(again(progress(60, 60), by="drive/nobody"))[0].gaps
    assert ours(again(progress(60, 60), by="Observer"))[0].previous == 60


def test_what_the_observer_tells_counts_before_the_program_is_deployed_again() -> None:
    stage = Stage(now_ns=10 * S)
    stage.handle(Ready(client="Observer", run="run", progress=progress(60, 60)))
    Leader(stage, "me/1").deploy(deployed())
    stage.ready()
    stage.pass_time(100 * MS)
    assert ours(stage)[0].previous == 60


def test_in_lockstep_time_goes_on_by_a_period() -> None:
    first = ours(again(progress(600, 600), lockstep=True))[0]
    assert first.t_ns == 601 * 50 * MS


def test_numbers_stay_above_all_that_were_used() -> None:
    first = ours(again(progress(150_000, 150_000, 150_007), now_ns=10 * S, lockstep=True))[0]
    assert (first.previous, first.k) == (150_000, 150_008)


def test_a_run_whose_leader_was_away_goes_on() -> None:
    stage = Stage()
    leader = Leader(stage, "me/1")
    leader.deploy(deployed())
    stage.ready()
    stage.until(200 * MS)
    (*_, last) = ours(stage)
    leader.close()
    stage.until(400 * MS)
    Leader(stage, "me/2").deploy(deployed())
    told = Progress(start=last.start, stepped=last.k, ticks=(last,))
    stage.handle(Ready(client=CLIENTS[0], run="run", progress=told))
    stage.ready()
    stage.until(600 * MS)
    assert {t.start for t in ours(stage)} == {last.start}
    assert any(t.previous == last.k < t.k - 1 for t in ours(stage))


# --- readers -----------------------------------------------------------------------------------------


@pytest.fixture
def reader() -> FrameAssembler:
    reader = FrameAssembler((BUMPER,), frames_kept=4)
    assert len(frames(reader, tick(0), base(0), tick(1), base(1))) == 2
    return reader


def test_a_reader_steps_across_the_gap(reader: FrameAssembler) -> None:
    found = frames(
        reader, tick(900, gaps=((1, 900),)), base(900, True), tick(901, gaps=((1, 900),)), base(901)
    )
    assert found == [Frame(900 * 50 * MS, {"bumper": True}), Frame(901 * 50 * MS, {"bumper": False})]
    assert not reader.lost


def test_it_learns_of_the_gap_from_any_later_tick(reader: FrameAssembler) -> None:
    effects = reader.take(tick(902, gaps=((1, 900),)))
    assert [s.message.k for s in effects if isinstance(s, SendMessage) and s.topic == "Clock/fetches"] == [
        900,
        901,
    ]  # type: ignore[union-attr]
    assert not reader.lost


def test_it_fetches_what_it_missed_before_the_gap(reader: FrameAssembler) -> None:
    effects = reader.take(tick(900, gaps=((3, 900),)))
    fetched = [s.message.k for s in effects if isinstance(s, SendMessage) and s.topic == "Clock/fetches"]  # type: ignore[union-attr]
    assert fetched == [2, 3]
    rest = (tick(2), base(2), tick(3), base(3), base(900))
    assert [f.t_ns // (50 * MS) for f in frames(reader, *rest)] == [2, 3, 900]


def test_frames_of_abandoned_ticks_do_not_count(reader: FrameAssembler) -> None:
    assert frames(reader, tick(2), tick(900, gaps=((1, 900),)), base(2), base(900)) == [
        Frame(900 * 50 * MS, {"bumper": False})
    ]


def test_another_gap_may_take_the_place_of_one(reader: FrameAssembler) -> None:
    found = frames(reader, tick(900, gaps=((1, 900),)), tick(2000, gaps=((1, 2000),)), base(900), base(2000))
    assert [f.t_ns // (50 * MS) for f in found] == [2000]


def test_who_stepped_over_an_abandoned_frame_is_lost(reader: FrameAssembler) -> None:
    assert frames(reader, tick(2), base(2))
    reader.take(tick(900, gaps=((1, 900),)))
    assert reader.lost


def test_memory_is_taken_across_the_gap(reader: FrameAssembler) -> None:
    anew = FrameAssembler((BUMPER,), frames_kept=4)
    anew.take(tick(900, gaps=((20, 900),)))
    assert anew.lost
    anew.resume(20)
    assert not anew.lost
    assert [f.t_ns // (50 * MS) for f in frames(anew, base(900))] == [900]
    anew.resume(500)
    assert anew.lost


def test_progress_is_told_of_the_newest_ticks(reader: FrameAssembler) -> None:
    assert FrameAssembler((BUMPER,)).progress is None
    assert reader.progress == Progress(start=0, stepped=1, ticks=(tick(0), tick(1)))
    for k in range(2, 300):
        reader.take(tick(k))
    told = reader.progress
    assert [t.k for t in told.ticks] == list(range(300 - MAX_REPORTED_TICKS, 300))
    reader.take(tick(300, lost=("x",) * (MAX_REPORTED_NAMES + 1)))
    assert reader.progress is None


def test_the_first_of_several_members_tells_of_progress(reader: FrameAssembler) -> None:
    members = Membership(("drive/avoid", "drive/cruise"), "", reader)
    other = Tick(k=2, t_ns=0, run="other")
    told = [
        send.message for send in members.on_tick(other, READY_INTERVAL_NS) if isinstance(send, SendMessage)
    ]
    assert [isinstance(m, Ready) and m.progress for m in told] == [reader.progress, None]


# --- messages ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "gaps", [((3, 3),), ((3, 11),), ((1, 5),), ((2, 5), (4, 8)), tuple((2, 3) for _ in range(MAX_GAPS + 1))]
)
def test_impossible_gaps_are_malformed(gaps: tuple[tuple[int, int], ...]) -> None:
    message = Tick(k=10, t_ns=0, start=2, gaps=gaps)
    with pytest.raises(MessageFormatError, match="gap"):
        check_plausible(message, 10 * S)
    report = Ready(client="c", progress=Progress(start=2, stepped=2, ticks=(message,)))
    with pytest.raises(MessageFormatError, match="gap"):
        check_plausible(report, 10 * S)


def test_possible_gaps_and_progress_are_not() -> None:
    message = Tick(k=10, t_ns=0, start=2, gaps=((2, 5), (5, 10)))
    check_plausible(message, 10 * S)
    check_plausible(Ready(client="c", progress=Progress(start=2, stepped=1, ticks=(message,))), 10 * S)
    with pytest.raises(MessageFormatError, match="epoch"):
        check_plausible(Ready(client="c", progress=Progress(start=3, stepped=1, ticks=())), 10 * S)


def test_a_frame_of_a_server_tells_nothing_of_gaps(reader: FrameAssembler) -> None:
    assert reader.take(ServerFrame(server="R", k=900, fields={})) == ()
    assert reader.next == 2
