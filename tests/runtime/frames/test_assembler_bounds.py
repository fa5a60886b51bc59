"""Frames put together at the edges: what is void counts for whom it concerns; nothing is kept for ever."""

from __future__ import annotations

import pytest

from colony.runtime.frames.assembler import MAX_FETCHES_PER_TICK, Awaited, FrameAssembler, frames_to_keep
from colony.runtime.protocol.bindings import SensorBinding
from colony.runtime.protocol.messages import Fetch, Sample, Send, ServerFrame, Tick
from tests.runtime.frames.test_assembler import (
    BUMPER,
    MS,
    PULSE,
    SONAR,
    active,
    base,
    frames,
    proximity,
    tick,
)


def behind(**more: object) -> FrameAssembler:
    """One that heard of frame 20 only, and cannot have what is before 17."""
    assembler = FrameAssembler((SONAR,), frames_kept=4)
    assembler.take(tick(20, **more))
    assert assembler.lost
    return assembler


@pytest.mark.parametrize(
    ("void", "resumed", "lost"),
    [
        (18, 18, True),  # memory saw frame 18 as it never was
        (18, 19, True),  # tick 20 tells so, and comes after memory
        (18, 20, False),  # memory knows of it
        (19, 18, False),  # frame 19 is still to come
        (20, 18, False),
    ],
)
def test_memory_is_of_no_use_if_it_saw_what_was_void_later(void: int, resumed: int, lost: bool) -> None:
    assembler = behind(void=(("P", void),))
    requests = assembler.resume(resumed)
    assert assembler.lost is lost
    assert (requests == ()) is (lost or resumed > 18)


def test_what_a_module_never_told_does_not_spoil_memory() -> None:
    assembler = FrameAssembler((), ("pulse",), frames_kept=4)
    assembler.take(tick(20, void=((PULSE, 18),)))
    assembler.resume(18)
    assert not assembler.lost


def test_what_is_there_already_is_not_asked_for() -> None:
    assembler = FrameAssembler((BUMPER,), frames_kept=4)
    assembler.take(tick(20))
    for k in (18, 19, 20):
        assembler.take(base(k))
    assert assembler.resume(18) == (Send("Clock/fetches", Fetch(server="Clock", k=19)),)
    assert len(frames(assembler, tick(19))) == 2


def test_to_resume_in_vain_asks_for_nothing() -> None:
    assembler = behind()
    assert assembler.resume(14) == ()
    assert assembler.lost


def test_skipping_leaves_out_only_what_cannot_be_had() -> None:
    assembler = FrameAssembler((BUMPER,), frames_kept=4)
    assert len(frames(assembler, tick(0), base(0))) == 1
    assembler.take(tick(4))
    assert (assembler.lost, assembler.skip(), assembler.next) == (False, 0, 1)
    assembler.take(tick(5))
    assert (assembler.lost, assembler.skip(), assembler.next) == (True, 4, 5)
    assert [f.t_ns for f in frames(assembler, base(5))] == [250 * MS]


def test_skipping_what_was_wrong_goes_on_with_the_next_frame() -> None:
    assembler = FrameAssembler((SONAR,), frames_kept=4)
    for k in range(6):
        assert len(frames(assembler, tick(k), proximity(k))) == 1
    assembler.take(tick(6, void=(("P", 5),)))
    assert assembler.lost
    assert (assembler.skip(), assembler.next, assembler.lost) == (0, 6, False)
    assert len(frames(assembler, proximity(6))) == 1


def test_what_is_void_before_the_epoch_or_of_a_server_that_is_not_read_does_not_matter() -> None:
    assembler = FrameAssembler((SONAR,))
    assert len(frames(assembler, tick(5, start=5, void=(("P", 3), ("R", 5))), proximity(5))) == 1
    assert len(frames(assembler, tick(6, start=5, void=(("P", 4), ("R", 5))), proximity(6))) == 1
    assert not assembler.lost


def test_with_degrade_a_module_is_not_active_where_the_server_that_hands_it_on_said_nothing() -> None:
    ways: tuple[Awaited, ...] = ("degrade", "living")
    for awaited in ways:
        assembler = FrameAssembler((), ("pulse",), awaited=awaited)
        assembler.take(tick(0))
        assert list(assembler.pop_complete()) == []
        assembler.take(tick(1, void=(("DServer", 0),)))
        answers = [a.answers for a in assembler.pop_complete()]
        assert answers == ([{}] if awaited == "degrade" else []), "an observer waits for those that live"


def test_a_module_that_is_down_is_waited_for_where_the_sensors_are_there() -> None:
    assembler = FrameAssembler((SONAR,), ("pulse",), frames_kept=4)
    for k in range(10):
        assembler.take(proximity(k))
        assembler.take(tick(k, down=(PULSE,)))
    assert not assembler.lost
    other = FrameAssembler((SONAR,), ("pulse",), frames_kept=4)
    for k in range(10):
        other.take(active(k))
        other.take(tick(k, down=(PULSE,)))
    assert other.lost


@pytest.mark.parametrize("most", [2, 3, 4])
def test_of_what_is_void_the_newest_is_remembered(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    """Three frames are void, of the frames 0, 1 and 2: the oldest is forgotten first."""
    monkeypatch.setattr("colony.runtime.frames.assembler.MAX_FRAMES_KEPT", most)
    assembler = FrameAssembler((SONAR, BUMPER), frames_kept=100)
    assembler.take(base(0))
    assembler.take(base(1))
    assembler.take(tick(0))
    assembler.take(tick(1))
    assembler.take(tick(2, void=(("P", 0), ("P", 1), ("P", 2))))
    assert len(list(assembler.pop_complete())) == (2 if most >= 3 else 0)


def test_a_tick_that_is_doubled_says_nothing_new() -> None:
    assembler = FrameAssembler((SONAR,))
    again = tick(1, down=("P",), void=(("P", 0),))
    assert len(frames(assembler, tick(0), again, tick(2, down=("P",)))) == 3
    for message in (again, tick(0), again):
        assert frames(assembler, message) == []
    assert not assembler.lost


def test_only_what_is_missing_of_who_lives_is_asked_for() -> None:
    def asked(*before: Tick | ServerFrame, **more: object) -> set[str]:
        assembler = FrameAssembler((SONAR, BUMPER))
        for message in before:
            assembler.take(message)
        return {e.message.server for e in assembler.take(tick(1, **more)) if isinstance(e, Send)}

    assert asked(tick(0)) == {"P", "R"}
    assert asked(tick(0), proximity(0)) == {"R"}
    assert asked(tick(0), base(0)) == {"P"}
    assert asked(tick(0), down=("P",)) == {"R"}
    assert asked(tick(0), void=(("P", 0),)) == {"R"}
    assert asked(tick(0), void=(("R", 0),)) == {"P"}


def test_a_portion_begins_behind_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("colony.runtime.frames.assembler.MAX_FETCHES_PER_TICK", 8)
    assembler = FrameAssembler((BUMPER,), frames_kept=100)
    for latest, numbers in ((20, (0, 1, 2, 3)), (21, (4, 5, 6, 7))):
        requests = assembler.take(tick(latest))
        assert requests[::2] == tuple(Send("Clock/fetches", Fetch(server="Clock", k=k)) for k in numbers)


def test_what_does_not_come_is_asked_for_again_after_twice_as_many_frames() -> None:
    """Frame 3 is missing: its age in frames counts, whatever its number."""
    assembler = FrameAssembler((BUMPER,), frames_kept=100)
    asked = []
    for k in range(24):
        requests = assembler.take(tick(k))
        if k != 3:
            assembler.take(base(k))
        list(assembler.pop_complete())
        asked += [k for e in requests if e == Send("R/fetches", Fetch(server="R", k=3))]
    assert asked == [3 + age for age in (1, 2, 4, 8, 16)]


def test_a_portion_ends_with_a_whole_frame() -> None:
    asked = FrameAssembler((SONAR, BUMPER)).take(tick(MAX_FETCHES_PER_TICK))
    assert len(asked) == 3 * (MAX_FETCHES_PER_TICK // 3 + 1)


def test_how_many_frames_are_kept() -> None:
    assert [frames_to_keep(ns) for ns in (50 * MS, 10**12, 1, 200_000)] == [40, 2, 10_000, 10_000]


def test_a_single_value_enters_in_base_units() -> None:
    meters = SensorBinding(sensor="m", server="P", field="sonar", max_age_ns=None, factor=1000.0)
    message = ServerFrame(server="P", k=0, fields={"sonar": Sample(1500.0, 0)})
    assert [f.readings for f in frames(FrameAssembler((meters,)), tick(0), message)] == [{"m": 1500.0}]


def test_what_did_not_come_is_asked_for_in_portions() -> None:
    asked = FrameAssembler((BUMPER,)).take(tick(MAX_FETCHES_PER_TICK))
    assert len(asked) == MAX_FETCHES_PER_TICK
    assert asked[:2] == (
        Send("Clock/fetches", Fetch(server="Clock", k=0)),
        Send("R/fetches", Fetch(server="R", k=0)),
    )
    assert asked[-1] == Send("R/fetches", Fetch(server="R", k=MAX_FETCHES_PER_TICK // 2 - 1))
