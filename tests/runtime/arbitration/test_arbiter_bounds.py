"""Arbitration at the edges: strangers, doubles, floods, the last moment, frames that nobody opened."""

from __future__ import annotations

import pytest
from msgspec import structs

from colony.ir.program import ActuatorField, in_declared_units
from colony.ir.servers import SPEED
from colony.ir.types import BOOL
from colony.runtime.arbitration.arbiter import (
    MAX_FRAMES_AHEAD,
    MAX_NOTE_LENGTH,
    MAX_NOTES,
    Arbiter,
    Dispatch,
    Timing,
    timing,
)
from colony.runtime.arbitration.ballot import (
    Ballot,
    Choice,
    ClientRanking,
    Interventions,
    OutsideCommand,
    request_error,
)
from colony.runtime.protocol.messages import Request, Tick, Verdict
from tests.runtime.arbitration.drive import DRIVE, MS, PLACES, TIMES, arbiter, ranked, request, table, tick


def outside(priority: int) -> OutsideCommand:
    return OutsideCommand("user/1", priority, (1.0, 2.0))


# --- who counts --------------------------------------------------------------------------------------


def test_priorities_are_those_given() -> None:
    assert [ClientRanking((("a", 10), ("b", 5))).above(p) for p in (4, 5, 9, 10)] == [2, 1, 1, 0]
    one = Arbiter(structs.replace(table(DRIVE), clients=(("a", 10), ("b", 5))), TIMES)
    one.open(tick(), frozenset(), 0, Interventions(commands=(outside(7),)))
    dispatch, *_ = one.receive(
        Request(k=0, actuator="drive", client="a", bid="command", values=(3.0, 4.0)), MS
    )
    assert (dispatch.by, dispatch.outside) == ("a", None)


def test_a_stranger_among_the_lost_is_nobody(one: Arbiter) -> None:
    assert one.open(tick(), frozenset({"stranger", "cruise"}), 0) == ()
    one.receive(request("back_off"), MS)
    *_, verdict = one.receive(request("avoid"), MS)
    assert verdict.fates == (("back_off", "silent"), ("avoid", "silent"), ("cruise", "lost"))


def test_whose_request_was_refused_is_noted_once(one: Arbiter) -> None:
    one.open(tick(), frozenset(), 0)
    for _ in range(3):
        one.receive(Request(k=0, actuator="drive", client="avoid", bid="command", values=(1.0,)), MS)
    one.receive(request("avoid", "command"), MS)
    *_, verdict = one.open(tick(1), frozenset(), 50 * MS)
    assert (len(verdict.notes), dict(verdict.fates)["avoid"]) == (1, "refused")


def test_who_is_late_is_noted_once(one: Arbiter) -> None:
    one.open(tick(), frozenset(), 0)
    assert [type(e) for e in one.wake(40 * MS)] == [Dispatch]
    for _ in range(3):
        assert one.receive(request("avoid", "command"), 41 * MS) == ()
    (verdict,) = one.open(tick(1), frozenset(), 50 * MS)[:1]
    assert verdict.notes == ("`avoid` commanded after the deadline",)
    assert not verdict.violation


def test_who_is_heard_within_the_deadline_after_the_dispatch_is_not_late(one: Arbiter) -> None:
    one.open(tick(), frozenset(), 0)
    one.receive(request("cruise", "command"), MS)
    (dispatch,) = one.wake(6 * MS)
    assert isinstance(dispatch, Dispatch)
    one.receive(request("avoid", "command"), 7 * MS)
    (verdict,) = one.receive(request("back_off"), 8 * MS)
    assert verdict.fates == (("back_off", "silent"), ("avoid", "overruled"), ("cruise", "won"))
    assert verdict.violation


# --- when --------------------------------------------------------------------------------------------


def test_the_deadline_counts_from_the_time_of_the_tick(one: Arbiter) -> None:
    assert one.wake_at is None
    one.open(Tick(k=0, t_ns=100 * MS), frozenset(), 130 * MS)
    assert one.wake_at == 140 * MS
    assert one.wake(140 * MS - 1) == ()
    assert [type(e) for e in one.wake(140 * MS)] == [Dispatch]
    assert one.wake_at is None


def test_the_grace_ends_no_later_than_the_deadline(one: Arbiter) -> None:
    one.open(tick(), frozenset(), 0)
    one.receive(request("cruise", "command"), 38 * MS)
    assert one.wake_at == 40 * MS
    one.receive(request("avoid", "command"), 10 * MS)
    assert one.wake_at == 15 * MS


def test_timing_of_very_short_frames() -> None:
    assert timing(50 * MS) == Timing(deadline_ns=40 * MS, grace_ns=5 * MS, from_arrival=False)
    assert isinstance(timing(50 * MS).deadline_ns, int)
    assert timing(1) == Timing(deadline_ns=1, grace_ns=0)
    assert timing(5, lockstep=True) == Timing(deadline_ns=4, grace_ns=0, from_arrival=True)


def test_a_frame_is_opened_once_and_closed_once(one: Arbiter) -> None:
    assert one.finish() == ()
    assert one.intervene(Interventions(hold="stopped"), 0) == ()
    assert one.wake(10**12) == ()
    one.open(tick(3), frozenset(PLACES), 0)
    assert one.open(tick(3), frozenset(), 0) == one.open(tick(2), frozenset(), 0) == ()
    assert one.finish() == ()  # all were lost: the verdict is out
    one.open(tick(4), frozenset(), 0)
    assert [type(e) for e in one.finish()] == [Dispatch, Verdict]
    assert one.finish() == ()
    assert one.receive(request("cruise", "command", k=4), 0) == ()


def test_what_comes_after_the_verdict_changes_nothing(one: Arbiter) -> None:
    one.open(tick(), frozenset(PLACES), 0)
    assert one.receive(Request(k=0, actuator="drive", client="x", bid="silent", values=None), 0) == ()
    assert one.receive(Request(k=-1, actuator="drive", client="x", bid="silent", values=None), 0) == ()
    *_, verdict = one.open(tick(1), frozenset(PLACES), 0)
    assert verdict.notes == ()


def test_before_the_first_frame_nothing_is_noted(one: Arbiter) -> None:
    for client in ("stranger", "cruise"):
        one.receive(Request(k=-1, actuator="drive", client=client, bid="command", values=(1.0,)), 0)
    *_, verdict = one.open(tick(), frozenset(PLACES), 0)
    assert verdict.notes == ()


# --- what is sent and told ---------------------------------------------------------------------------


def test_a_command_with_a_fault_is_not_sent_whatever_its_values(one: Arbiter) -> None:
    one.open(Tick(k=0, t_ns=77), frozenset(), 0)
    faulty = Request(k=0, actuator="drive", client="back_off", bid="command", values=(1.0, 2.0), fault="odd")
    (dispatch,) = one.receive(faulty, MS)
    assert dispatch == Dispatch(0, "back_off", (0.0, 0.0), "odd")
    *_, verdict = one.finish()
    assert (verdict.t_ns, verdict.fault, verdict.values) == (77, "odd", (0.0, 0.0))


def test_only_what_has_a_unit_changes_on_its_way_out() -> None:
    fields = (
        ActuatorField(name="on", type=BOOL),
        ActuatorField(name="count", type=SPEED),
        ActuatorField(name="way", type=SPEED, factor=1000.0),
    )
    assert repr(in_declared_units((True, 3, 1500.0), fields)) == repr((True, 3, 1.5))
    assert in_declared_units(None, fields) is None


@pytest.mark.parametrize(
    ("velocity", "taken"), [(-600.0, True), (600.0, True), (-600.1, False), (600.1, False)]
)
def test_both_ends_of_a_range_are_in_it(velocity: float, taken: bool) -> None:
    command = Request(k=0, actuator="drive", client="cruise", bid="command", values=(velocity, 0.0))
    wrong = None if taken else f"`cruise` gave velocity = {velocity!r}"
    assert request_error(command, table(DRIVE), PLACES) == wrong


# --- ahead of time -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ahead", "kept"), [(1, True), (MAX_FRAMES_AHEAD, True), (MAX_FRAMES_AHEAD + 1, False)]
)
@pytest.mark.parametrize("now", [0, 1, 7])
def test_a_request_comes_at_most_so_many_frames_ahead(one: Arbiter, now: int, ahead: int, kept: bool) -> None:
    one.open(tick(now), frozenset(), now * 50 * MS)
    one.receive(request("back_off", "command", k=now + ahead), 0)
    events = one.open(tick(now + ahead), frozenset(), (now + ahead) * 50 * MS)
    assert (events[-1] == Dispatch(now + ahead, "back_off", (-200.0, 15.0), None)) is kept


def test_before_the_first_frame_requests_of_so_many_frames_are_kept() -> None:
    for frames, kept in ((MAX_FRAMES_AHEAD, True), (MAX_FRAMES_AHEAD + 1, False)):
        one = arbiter()
        for k in range(frames):
            one.receive(request("back_off", "command", k=10 * k), 0)
        one.receive(request("avoid", k=0), 0)  # of a frame that is known there may be more
        last = 10 * (frames - 1)
        events = one.open(tick(last), frozenset(), 0)
        assert (events == (Dispatch(last, "back_off", (-200.0, 15.0), None),)) is kept
    one = arbiter()
    for k in range(MAX_FRAMES_AHEAD):
        one.receive(request("cruise", k=k), 0)
    one.receive(request("back_off", "command", k=0), 0)
    assert one.open(tick(0), frozenset(), 0) == (Dispatch(0, "back_off", (-200.0, 15.0), None),)


@pytest.mark.parametrize(("doubles", "heard"), [(5, True), (6, False)])
def test_of_one_frame_no_more_is_kept_than_two_of_each(one: Arbiter, doubles: int, heard: bool) -> None:
    one.open(tick(0), frozenset(), 0)
    for _ in range(doubles):
        one.receive(request("cruise", k=5), 0)
    one.receive(request("stranger", "command", k=5), 0)
    one.receive(request("back_off", "command", k=5), 0)
    assert (
        one.open(tick(5), frozenset(), 250 * MS)[-1] == Dispatch(5, "back_off", (-200.0, 15.0), None)
    ) is heard


def test_what_was_kept_for_frames_that_did_not_come_is_forgotten(one: Arbiter) -> None:
    for k in (1, 2, 3):
        one.receive(request("back_off", "command", k=k), 0)
    one.open(tick(2), frozenset(), 0)
    assert one.open(tick(3), frozenset(), 0)[-1] == Dispatch(3, "back_off", (-200.0, 15.0), None)


# --- notes -------------------------------------------------------------------------------------------


def test_a_note_of_the_longest_length_is_whole(one: Arbiter) -> None:
    one.open(tick(), frozenset(), 0)
    one.add_note("x" * MAX_NOTE_LENGTH)
    one.add_note("y" * (MAX_NOTE_LENGTH + 1))
    for n in range(MAX_NOTES):
        one.add_note(str(n))
    *_, verdict = one.finish()
    assert verdict.notes[0] == "x" * MAX_NOTE_LENGTH
    assert verdict.notes[1] == "y" * (MAX_NOTE_LENGTH - 3) + "..."
    assert len(verdict.notes) == MAX_NOTES


def test_a_remark_while_dispatched_is_of_this_frame_and_one_after_it_of_the_next(one: Arbiter) -> None:
    one.open(tick(), frozenset(), 0)
    one.wake(40 * MS)
    one.add_note("now")
    (verdict,) = one.finish()
    one.add_note("later")
    one.open(tick(1), frozenset(), 50 * MS)
    *_, after = one.finish()
    assert (verdict.notes, after.notes) == (("now",), ("later",))


# --- the rule ----------------------------------------------------------------------------------------


def test_a_lost_client_that_commands_counts_neither_as_command_nor_as_heard() -> None:
    ballot = Ballot(ClientRanking(ranked(*PLACES)), ["back_off"])
    ballot.take(request("back_off", "command"))
    assert (ballot.command_count, ballot.complete) == (0, False)
    assert ballot.choose(Interventions()) == Choice(None, None, False)
    ballot.take(request("cruise", "command"))
    ballot.take(request("cruise", "command"))
    assert ballot.command_count == 1
    assert ballot.choose(Interventions()) == Choice("cruise", None, False)
    ballot.take(request("avoid"))
    assert ballot.complete
    assert ballot.choose(Interventions()) == Choice("cruise", None, True)


def test_the_highest_of_several_commands_counts() -> None:
    ballot = Ballot(ClientRanking(tuple(zip(PLACES, (30, 20, 10), strict=True))), ())
    for client in ("avoid", "cruise"):
        ballot.take(request(client, "command"))
    assert ballot.choose(Interventions()) == Choice("avoid", None, False)
    assert ballot.choose(Interventions(commands=(outside(15),))) == Choice("avoid", None, False)
    assert ballot.choose(Interventions(commands=(outside(25),))) == Choice(None, outside(25), False)
    ballot.mark_late("back_off")
    assert ballot.choose(Interventions(commands=(outside(25),))) == Choice(None, outside(25), True)


def test_while_locked_only_the_command_of_the_holder_acts() -> None:
    ballot = Ballot(ClientRanking(ranked(*PLACES)), ())
    other = OutsideCommand("other/1", 9, (0.0, 0.0))
    for holder, found in (("user/1", outside(3)), ("other/1", other), ("third/1", None), (None, None)):
        interventions = Interventions(commands=(other, outside(3)), hold="locked", holder=holder)
        assert ballot.choose(interventions) == Choice(None, found, True)
    stopped = Interventions(commands=(other,), hold="stopped", holder="other/1")
    assert ballot.choose(stopped) == Choice(None, None, True)
