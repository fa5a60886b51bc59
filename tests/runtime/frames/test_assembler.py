"""Frames are put together whatever the order of arrival, and only an explicit absence is missing."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any, Literal

import pytest

from colony.ir.frame import Answer, Frame
from colony.runtime.frames.assembler import MAX_FETCHES_PER_TICK, Awaited, FrameAssembler, frames_to_keep
from colony.runtime.protocol.bindings import SensorBinding
from colony.runtime.protocol.messages import Fetch, Sample, SendMessage, ServerFrame, Tick
from tests.kit.node_stage import MS

SONAR = SensorBinding(sensor="sonar", server="P", field="sonar", max_age_ns=300 * MS, factor=1.0)
BUMPER = SensorBinding(sensor="bumper", server="R", field="bumper", max_age_ns=None, factor=1.0)
METERS = SensorBinding(sensor="m", server="P", field="sonar", max_age_ns=None, factor=1000.0)


@pytest.fixture
def assembler() -> FrameAssembler:
    return FrameAssembler((BUMPER,), frames_kept=4)


def tick(k: int, **more: Any) -> Tick:
    return Tick(k=k, t_ns=k * 50 * MS, **more)


def proximity(k: int, value: tuple[float, ...] = (1.0, 2.0), t_ns: int | None = None) -> ServerFrame:
    return ServerFrame(
        server="P", k=k, fields={"sonar": Sample(value, k * 50 * MS if t_ns is None else t_ns)}
    )


def base(k: int, bumper: bool = False) -> ServerFrame:
    return ServerFrame(server="R", k=k, fields={"bumper": Sample(bumper, k * 50 * MS)})


def frames(assembler: FrameAssembler, *messages: Tick | ServerFrame) -> list[Frame]:
    out = []
    for message in messages:
        assembler.take(message)
        out += [a.frame for a in assembler.pop_complete()]
    return out


def test_any_order_and_doubled_messages_give_the_same_frames() -> None:
    messages: tuple[Tick | ServerFrame, ...] = (
        tick(0),
        proximity(0),
        base(0),
        tick(1),
        proximity(1),
        base(1, True),
    )
    expected = [
        Frame(0, {"sonar": (1.0, 2.0), "bumper": False}),
        Frame(50 * MS, {"sonar": (1.0, 2.0), "bumper": True}),
    ]
    for order in itertools.permutations(messages):
        assert frames(FrameAssembler((SONAR, BUMPER)), *order, *order) == expected


def test_a_value_older_than_within_is_missing_and_one_just_as_old_is_not() -> None:
    binding = (SONAR,)
    assert frames(FrameAssembler(binding), tick(0), proximity(0, t_ns=-300 * MS))[0].readings
    assert not frames(FrameAssembler(binding), tick(0), proximity(0, t_ns=-300 * MS - 1))[0].readings


def test_no_value_is_missing() -> None:
    silent = ServerFrame(server="P", k=0, fields={"sonar": None})
    assert frames(FrameAssembler((SONAR,)), tick(0), silent) == [Frame(0, {})]
    nothing = ServerFrame(server="P", k=0, fields={})
    assert frames(FrameAssembler((SONAR,)), tick(0), nothing) == [Frame(0, {})]


def test_a_frame_not_delivered_is_no_missing_sensor_but_is_fetched() -> None:
    assembler = FrameAssembler((SONAR, BUMPER))
    assert frames(assembler, tick(0), base(0)) == []
    assert assembler.take(tick(1)) == (SendMessage("P/fetches", Fetch(server="P", k=0)),)
    assert frames(assembler, base(1), proximity(1)) == []
    assert [f.t_ns for f in frames(assembler, proximity(0))] == [0, 50 * MS]


def test_a_tick_not_delivered_is_fetched() -> None:
    assembler = FrameAssembler((BUMPER,))
    assembler.take(base(0))
    assert assembler.take(tick(1)) == (SendMessage("Clock/fetches", Fetch(server="Clock", k=0)),)


def test_only_the_newest_frame_is_current() -> None:
    assembler = FrameAssembler((BUMPER,))
    for message in (tick(0), tick(1), base(1), base(0)):
        assembler.take(message)
    assert [a.current for a in assembler.pop_complete()] == [False, True]


def test_the_sensors_of_a_server_that_is_down_are_missing_even_if_its_frame_comes() -> None:
    assembler = FrameAssembler((SONAR, BUMPER))
    assert frames(assembler, base(0), tick(0, down=("P",))) == [Frame(0, {"bumper": False})]
    assert frames(assembler, proximity(1), base(1), tick(1, down=("P",))) == [
        Frame(50 * MS, {"bumper": False})
    ]


def test_frames_that_a_dead_server_did_not_give_are_waited_for_until_a_tick_says_that_they_are_void() -> None:
    assembler = FrameAssembler((SONAR, BUMPER))
    assert frames(assembler, tick(0), base(0), tick(1), base(1)) == []
    assert frames(assembler, base(2), tick(2, down=("P",))) == []
    got = frames(assembler, base(3), tick(3, down=("P",), void=(("P", 0), ("P", 1))))
    assert [f.readings for f in got] == [{"bumper": False}] * 4
    assert not assembler.lost


def test_what_is_void_does_not_count_if_it_comes_after_all() -> None:
    assembler = FrameAssembler((SONAR, BUMPER))
    got = frames(assembler, tick(0), tick(1, down=("P",), void=(("P", 0),)), proximity(0), base(0), base(1))
    assert [f.readings for f in got] == [{"bumper": False}] * 2


def test_who_handed_out_what_is_void_later_is_lost_until_the_next_epoch() -> None:
    assembler = FrameAssembler((SONAR, BUMPER))
    assert len(frames(assembler, tick(0), base(0), proximity(0))) == 1
    assert frames(assembler, tick(1, void=(("P", 0),)), base(1), proximity(1)) == []
    assert assembler.lost
    (anew,) = frames(assembler, tick(2, start=2), base(2), proximity(2))
    assert anew.t_ns == 100 * MS
    assert not assembler.lost


# --- epochs and runs -------------------------------------------------------------------------------


def test_a_new_epoch_forgets_what_is_before_it() -> None:
    assembler = FrameAssembler((BUMPER,))
    assembler.take(tick(0))
    assembler.take(base(4))  # came before its tick
    assert assembler.take(tick(5, start=4)) == (SendMessage("Clock/fetches", Fetch(server="Clock", k=4)),)
    out = []
    for message in (tick(4, start=4), base(5), tick(1), base(0)):
        assembler.take(message)
        out += list(assembler.pop_complete())
    assert [(a.tick.k, a.restart, a.current) for a in out] == [(4, True, False), (5, False, True)]
    assert assembler.start == 4


def test_ticks_of_another_run_are_not_for_us() -> None:
    assembler = FrameAssembler((BUMPER,), run="mine")
    assert frames(assembler, tick(0, run="yours"), base(0)) == []
    assert assembler.start == -1
    assert len(frames(assembler, tick(1, run="mine", start=1), base(1))) == 1
    assert frames(assembler, tick(2, run="", start=2), base(2)) == []
    assert (assembler.start, assembler.latest) == (1, 1)


def test_an_epoch_that_begins_after_its_frame_is_none() -> None:
    assembler = FrameAssembler((BUMPER,))
    assert frames(assembler, tick(0), base(0), tick(1, start=2)) == [Frame(0, {"bumper": False})]
    assert (assembler.start, assembler.latest) == (0, 0)


# --- what cannot be had ----------------------------------------------------------------------------


def test_who_comes_late_steps_through_the_epoch_if_it_is_still_to_be_had(assembler: FrameAssembler) -> None:
    asked = assembler.take(tick(3))
    assert [e.message.k for e in asked if isinstance(e, SendMessage) and isinstance(e.message, Fetch)] == [
        *(0, 0, 1, 1, 2, 2)
    ]
    assert not assembler.lost
    late = FrameAssembler((BUMPER,), frames_kept=4)
    assert late.take(tick(4)) == ()
    assert late.lost


def test_who_falls_behind_for_longer_than_frames_are_kept_is_lost(assembler: FrameAssembler) -> None:
    assert len(frames(assembler, tick(0), base(0))) == 1
    for k in range(2, 5):
        assert frames(assembler, tick(k), base(k)) == []
        assert not assembler.lost
    assert frames(assembler, tick(5), base(5)) == []
    assert assembler.lost


def test_with_memory_from_elsewhere_it_goes_on(assembler: FrameAssembler) -> None:
    assembler.take(tick(20))
    assert assembler.lost
    assert assembler.resume(18) == (
        SendMessage("Clock/fetches", Fetch(server="Clock", k=19)),
        SendMessage("R/fetches", Fetch(server="R", k=19)),
    )
    assert not assembler.lost
    out = frames(assembler, tick(19), base(20), base(19))
    assert [f.t_ns for f in out] == [19 * 50 * MS, 20 * 50 * MS]


def test_what_waits_is_bounded(assembler: FrameAssembler) -> None:
    for k in range(1000):
        assembler.take(base(k))
        assembler.take(tick(k + 1))
    assert len(assembler._ticks) <= 8
    assert len(assembler._frames) <= 8


# --- the activity of modules in Python ---------------------------------------------------------------

PULSE = "DServer/activity/pulse"


def active(k: int, value: bool = True) -> ServerFrame:
    """What DServer publishes of a module in Python."""
    command = Sample((float(k), True), k) if value else None
    return ServerFrame(server=PULSE, k=k, fields={"command": command, "error": Sample(not value, k)})


def test_the_activity_of_a_module_is_waited_for_whoever_is_down() -> None:
    assembler = FrameAssembler((), ("pulse",))
    assembler.take(tick(0))
    (asked,) = assembler.take(tick(1, down=("R",)))
    assert asked == SendMessage("DServer/fetches", Fetch(server=PULSE, k=0))
    assembler.take(tick(2, down=(PULSE,), void=((PULSE, 0), (PULSE, 1))))
    assert list(assembler.pop_complete()) == []
    for k in range(3):
        assembler.take(active(k, k == 1))
    wrong = Answer(None, error=True)
    assert [a.answers for a in assembler.pop_complete()] == [
        {"pulse": Answer((1.0, True)) if k == 1 else wrong} for k in range(3)
    ]


@pytest.mark.parametrize("awaited", ["degrade", "living"])
def test_a_module_that_does_not_live_is_left_out_where_it_is_not_awaited(
    awaited: Literal["degrade", "living"],
) -> None:
    assembler = FrameAssembler((), ("pulse",), awaited=awaited)
    assembler.take(active(0))
    assembler.take(tick(0))
    assembler.take(tick(1))
    assembler.take(tick(2, down=(PULSE,), void=((PULSE, 1),)))
    assembler.take(tick(3, down=("DServer",)))
    left_out: list[list[str]] = [[]] * (3 if awaited == "degrade" else 2)
    assert [[*a.answers] for a in assembler.pop_complete()] == [["pulse"], *left_out]


def test_a_new_epoch_is_not_asked_for_while_the_module_is_down() -> None:
    assembler = FrameAssembler((), ("pulse",), frames_kept=4)
    for k in range(10):
        assembler.take(tick(k, down=(PULSE,) if k else ()))
    assert not assembler.lost
    assembler.take(tick(10))
    assert assembler.lost


def test_without_sensors_every_tick_is_a_frame() -> None:
    assert frames(FrameAssembler(()), tick(0), tick(1)) == [Frame(0, {}), Frame(50 * MS, {})]


@pytest.mark.parametrize("binding", [METERS, replace(METERS, declared=True)], ids=["device", "variable"])
@pytest.mark.parametrize("value", [(1.5, 0.25), 1.5])
def test_values_enter_in_base_units_and_for_people_in_the_declared_unit(
    binding: SensorBinding, value: Any
) -> None:
    base_units = tuple(1000.0 * x for x in value) if isinstance(value, tuple) else 1000.0 * value
    message = proximity(0, value if binding.declared else base_units)
    for declared_units, entered in ((False, base_units), (True, value)):
        assembler = FrameAssembler((binding,), declared_units=declared_units)
        assert [f.readings for f in frames(assembler, tick(0), message)] == [{"m": entered}]


@pytest.mark.parametrize("value", [True, "far", None, math.nan])
def test_what_is_no_number_stays_what_it_is_and_is_a_fault(value: Any) -> None:
    for binding in (METERS, replace(METERS, declared=True)):
        assert repr(binding.in_base_units((2.0, value))) == repr(
            (2.0 if not binding.declared else 2000.0, value)
        )
        assert repr(binding.in_base_units(value)) == repr(binding.in_declared_units(value)) == repr(value)


# --- frames put together at the edges ---


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
    assert assembler.resume(18) == (SendMessage("Clock/fetches", Fetch(server="Clock", k=19)),)
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
        return {e.message.server for e in assembler.take(tick(1, **more)) if isinstance(e, SendMessage)}

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
        assert requests[::2] == tuple(
            SendMessage("Clock/fetches", Fetch(server="Clock", k=k)) for k in numbers
        )


def test_what_does_not_come_is_asked_for_again_after_twice_as_many_frames() -> None:
    """Frame 3 is missing: its age in frames counts, whatever its number."""
    assembler = FrameAssembler((BUMPER,), frames_kept=100)
    asked = []
    for k in range(24):
        requests = assembler.take(tick(k))
        if k != 3:
            assembler.take(base(k))
        list(assembler.pop_complete())
        asked += [k for e in requests if e == SendMessage("R/fetches", Fetch(server="R", k=3))]
    assert asked == [3 + age for age in (1, 2, 4, 8, 16)]


def test_a_portion_ends_with_a_whole_frame() -> None:
    asked = FrameAssembler((SONAR, BUMPER)).take(tick(MAX_FETCHES_PER_TICK))
    assert len(asked) == 3 * (MAX_FETCHES_PER_TICK // 3 + 1)


def test_how_many_frames_are_kept() -> None:
    assert [frames_to_keep(ns) for ns in (50 * MS, 10**12, 1, 200_000)] == [40, 2, 10_000, 10_000]


def test_what_did_not_come_is_asked_for_in_portions() -> None:
    asked = FrameAssembler((BUMPER,)).take(tick(MAX_FETCHES_PER_TICK))
    assert len(asked) == MAX_FETCHES_PER_TICK
    assert asked[:2] == (
        SendMessage("Clock/fetches", Fetch(server="Clock", k=0)),
        SendMessage("R/fetches", Fetch(server="R", k=0)),
    )
    assert asked[-1] == SendMessage("R/fetches", Fetch(server="R", k=MAX_FETCHES_PER_TICK // 2 - 1))
