"""Ticks come a period apart and say who is not heard of; runs begin when all are ready and end with their
leader; memory begins anew once for whoever lost it."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest

from colony.ir.frame import Answer
from colony.runtime.frames.clock import IDLE_FRAME_NS, LEADER_LEASE_NS, READY_TIMEOUT_NS
from colony.runtime.frames.registry import Liveness, TickAnswers, lease
from colony.runtime.library import clock as library
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.interface import Interface, interface_of
from colony.runtime.protocol.messages import (
    Announcement,
    Fetch,
    Ready,
    Restart,
    SendMessage,
    ServerFrame,
    Wake,
)
from tests.kit.clock import CLIENTS, Leader, Stage, deployed, verdict
from tests.kit.node_stage import MS, S, messages
from tests.runtime.programs import roam

# --- a robot without a program -----------------------------------------------------------------------


def test_a_robot_without_a_program_has_frames_too() -> None:
    stage = Stage(now_ns=7 * S)
    stage.until(7 * S + 100 * MS)
    assert [(t.k, t.t_ns, t.run, t.start) for t in stage.ticks] == [
        (70_000, 7 * S, "", 70_000),
        (70_001, 7 * S + 50 * MS, "", 70_000),
        (70_002, 7 * S + 100 * MS, "", 70_000),
    ]
    assert IDLE_FRAME_NS == 50 * MS


def test_a_clock_that_is_started_anew_never_gives_a_number_again() -> None:
    first = Stage()
    first.until(10 * S)
    again = Stage(now_ns=first.now_ns)
    again.until(first.now_ns)
    assert again.ticks[0].k > first.ticks[-1].k
    assert again.ticks[0].start == again.ticks[0].k


def test_ticks_are_at_whole_periods_even_when_woken_late() -> None:
    stage = Stage(now_ns=1000)
    stage.until(2000)
    stage.now_ns = 1000 + 50 * MS + 7777
    stage.handle(Wake())
    assert [t.t_ns for t in stage.ticks] == [1000, 1000 + 50 * MS]


def test_a_clock_that_was_stopped_leaves_out_what_it_missed_and_blames_nobody(stage: Stage) -> None:
    stage.until(100 * MS)
    stage.now_ns = 5 * S + 10 * MS
    stage.handle(Wake())
    stage.until(5 * S + 60 * MS)
    assert [(t.k, t.t_ns) for t in stage.ticks[2:]] == [(2, 100 * MS), (3, 5 * S), (4, 5 * S + 50 * MS)]
    assert stage.ticks[3].down == ()


def test_it_keeps_the_last_ticks() -> None:
    stage = Stage(frames_kept=3)
    stage.until(200 * MS)
    assert stage.fetched(4) == [stage.ticks[4]]
    assert stage.fetched(1) == []


# --- who lives ---------------------------------------------------------------------------------------


def test_a_server_that_is_not_heard_of_is_down_its_frames_are_void_and_it_may_come_back(stage: Stage) -> None:
    stage.until(100 * MS)
    stage.until(600 * MS, answering=("RServer",))
    down = [t.k for t in stage.ticks if t.down == ("PServer",)]
    assert down == [8, 9, 10, 11, 12]
    assert stage.ticks[8].void == tuple(("PServer", k) for k in range(3, 8))
    assert not any(t.void for t in stage.ticks if t.k != 8)
    stage.until(650 * MS)
    stage.until(700 * MS)
    assert stage.ticks[14].down == ()


def test_a_frame_that_was_not_heard_of_is_asked_for_again(stage: Stage) -> None:
    stage.until(50 * MS)
    stage.until(100 * MS, answering=("RServer",))
    stage.until(200 * MS)
    asked = [SendMessage("PServer/fetches", fetch) for fetch in messages(stage.effects, Fetch)]
    assert asked == [SendMessage("PServer/fetches", Fetch(server="PServer", k=2))]
    stage.handle(ServerFrame(server="PServer", k=2, fields={}))
    stage.until(600 * MS, answering=("RServer",))
    assert not any(("PServer", 2) in t.void for t in stage.ticks)


def test_what_a_server_did_not_answer_before_it_was_started_anew_is_void_at_once(stage: Stage) -> None:
    stage.until(100 * MS)
    stage.until(150 * MS, answering=("RServer",))
    stage.until(200 * MS, answering=("RServer",))
    stage.handle(ServerFrame(server="PServer", k=4, fields={}, since=4))
    stage.until(250 * MS)
    assert stage.ticks[5].void == (("PServer", 3),)
    assert stage.ticks[5].down == ()


def test_clients_live_as_long_as_they_say_that_they_send_requests() -> None:
    stage = Stage(deployed())
    stage.ready()
    stage.until(100 * MS)
    for k in range(3, 13):
        stage.handle(Ready(client="drive/avoid", run="run", k=k - 1))
        stage.ready(clients=("drive/cruise",))  # that it listens is no request
        stage.handle(Ready(client="drive/back_off", run="another run", k=k - 1))
        stage.until(k * 50 * MS)
    assert stage.ticks[4].lost == ()
    assert stage.ticks[-1].lost == ("drive/back_off", "drive/cruise")
    stage.handle(Ready(client="drive/cruise", run="run", k=stage.ticks[-1].k))
    stage.pass_time(50 * MS)
    assert stage.ticks[-1].lost == ("drive/back_off",)


# --- runs --------------------------------------------------------------------------------------------


def test_a_run_begins_when_all_are_ready(stage: Stage) -> None:
    stage.until(70 * MS)
    leader = Leader(stage, "me/1")
    assert leader.deploy(deployed()) is None
    stage.ready(clients=CLIENTS[1:])
    stage.ready(run="another run")
    stage.until(120 * MS)
    assert {t.run for t in stage.ticks} == {""}
    stage.ready()
    stage.until(220 * MS)
    ours = [t for t in stage.ticks if t.run == "run"]
    assert [(t.k, t.start, t.t_ns) for t in ours] == [
        (3, 3, 120 * MS),
        (4, 3, 170 * MS),
        (5, 3, 220 * MS),
    ]
    assert stage.ticks[-1] is ours[-1]


def test_who_is_not_ready_in_time_is_lost() -> None:
    stage = Stage(deployed())
    stage.ready(clients=CLIENTS[:2])
    stage.until(READY_TIMEOUT_NS)
    first = next(t for t in stage.ticks if t.run == "run")
    assert (first.t_ns, first.lost) == (READY_TIMEOUT_NS, ("drive/cruise",))
    assert stage.ticks[0].t_ns == IDLE_FRAME_NS


def test_one_run_at_a_time(stage: Stage) -> None:
    one, other = Leader(stage, "me/1"), Leader(stage, "you/1")
    assert one.deploy(deployed("a")) is None
    assert one.deploy(deployed("a")) is None
    assert other.deploy(deployed("b")) == "busy"
    assert one.deploy(replace_frame(deployed("a"), 0)) == "arguments"
    one.close()
    assert other.deploy(deployed("b")) is None


def replace_frame(what: Deployment, frame_ns: int) -> Deployment:
    return msgspec.structs.replace(what, frame_ns=frame_ns)


def test_a_run_ends_with_its_leader() -> None:
    for silently in (False, True):
        stage = Stage()
        leader = Leader(stage, "me/1")
        leader.deploy(deployed(program=roam(robot=replace(roam().robot, frame_ns=20 * MS))))
        stage.ready()
        for _ in range(10):
            stage.pass_time(100 * MS)
            leader.alive()
        assert stage.ticks[-1].run == "run"
        if silently:
            stage.pass_time(LEADER_LEASE_NS - 100 * MS)
            assert stage.ticks[-1].run == "run"
            stage.pass_time(200 * MS)
        else:
            leader.close()
            stage.pass_time(200 * MS)
        a, b = stage.ticks[-2:]
        assert (a.run, b.run, b.t_ns - a.t_ns) == ("", "", IDLE_FRAME_NS)
        assert a.start == b.start > next(t for t in stage.ticks if t.run == "run").k


def test_who_leads_the_same_run_again_changes_nothing(stage: Stage) -> None:
    one = Leader(stage, "me/1")
    one.deploy(deployed())
    stage.ready()
    stage.until(100 * MS)
    other = Leader(stage, "me/2")
    assert other.deploy(deployed()) is None
    one.close()
    stage.until(200 * MS)
    assert {t.start for t in stage.ticks if t.run == "run"} == {1}
    assert stage.ticks[-1].run == "run"


def test_a_leader_that_was_away_leads_the_same_run_in_a_new_epoch(stage: Stage) -> None:
    leader = Leader(stage, "me/1")
    leader.deploy(deployed())
    stage.ready()
    stage.until(100 * MS)
    leader.close()
    stage.until(300 * MS)
    assert Leader(stage, "me/2").deploy(deployed()) is None
    stage.until(400 * MS)
    assert stage.ticks[-1].run == ""
    stage.ready()
    stage.until(500 * MS)
    assert len({t.start for t in stage.ticks if t.run == "run"}) == 2
    assert [t.k for t in stage.ticks] == list(range(len(stage.ticks)))


# --- epochs ------------------------------------------------------------------------------------------


def running() -> Stage:
    stage = Stage(deployed())
    stage.ready()
    stage.until(100 * MS)
    return stage


def test_who_lost_its_memory_makes_everyone_begin_anew_once() -> None:
    stage = running()
    stage.handle(*(Restart(client=c, start=0) for c in CLIENTS))
    stage.handle(Restart(client=CLIENTS[0], start=0))
    stage.until(150 * MS)
    stage.handle(*(Restart(client=c, start=0) for c in CLIENTS))
    stage.until(250 * MS)
    assert [(t.k, t.start) for t in stage.ticks] == [(0, 0), (1, 0), (2, 0), (3, 3), (4, 3), (5, 3)]
    assert [t.t_ns for t in stage.ticks] == [k * 50 * MS for k in range(6)]


@pytest.mark.parametrize("start", [-1, 1, 99])
def test_of_another_epoch_or_from_a_stranger_it_is_ignored(start: int) -> None:
    stage = running()
    stage.handle(Restart(client=CLIENTS[0], start=start), Restart(client="drive/nobody", start=0))
    stage.until(300 * MS)
    assert {t.start for t in stage.ticks} == {0}


def test_the_observer_may_ask_for_a_new_epoch_of_a_run_that_goes_on() -> None:
    stage = running()
    stage.handle(Restart(client="Observer", start=0))
    stage.until(200 * MS)
    assert [(t.k, t.start) for t in stage.ticks] == [(0, 0), (1, 0), (2, 0), (3, 3), (4, 3)]
    idle = Stage()
    idle.until(100 * MS)
    idle.handle(Restart(client="Observer", start=0))
    idle.until(200 * MS)
    assert {t.start for t in idle.ticks} == {0}


# --- lockstep ----------------------------------------------------------------------------------------


def test_in_lockstep_a_frame_follows_as_soon_as_the_one_before_is_decided() -> None:
    stage = Stage(deployed(lockstep=True))
    stage.ready()
    for k in range(100):
        stage.now_ns += 1 * MS
        stage.handle(verdict(k))
        stage.handle(verdict(k))
    assert [(t.k, t.t_ns) for t in stage.ticks] == [(k, k * 50 * MS) for k in range(101)]


def test_in_lockstep_nobody_is_waited_for_longer_than_a_period() -> None:
    stage = Stage(deployed(lockstep=True))
    stage.ready()
    stage.now_ns = 10 * MS
    stage.handle(verdict(0))
    stage.until(59 * MS)
    assert len(stage.ticks) == 2
    stage.until(60 * MS)
    assert [t.t_ns for t in stage.ticks] == [0, 50 * MS, 100 * MS]


# --- who ---------------------------------------------------------------------------------------------


def test_who_takes_part(stage: Stage) -> None:
    leader = Leader(stage, "me/1")
    leader.deploy(deployed())
    stage.ready(clients=CLIENTS[:1])
    before = leader.who()
    assert (before.run, before.program, before.leader, before.begun) == ("run", "rome", "me/1", False)
    assert [c.ready for c in before.clients] == [True, False, False]
    stage.ready()
    stage.until(100 * MS, answering=("RServer",))
    tick = stage.ticks[-1]
    stage.handle(Ready(client=CLIENTS[1], run="run", k=tick.k))
    stage.handle(verdict(tick.k - 1, ("back_off", "lost"), ("avoid", "late"), ("u/1", "won")))
    stage.handle(verdict(tick.k, ("back_off", "lost"), ("avoid", "won"), ("u/1", "overridden")))
    stage.handle(Restart(client=CLIENTS[0], start=tick.start))
    stage.until(300 * MS, answering=("RServer",))
    after = leader.who()
    assert (after.begun, after.restarts, after.frame_ns) == (True, 1, 50 * MS)
    assert after.k == stage.ticks[-1].k
    assert [(s.server, s.up) for s in after.servers] == [("PServer", False), ("RServer", True)]
    avoid = after.clients[1]
    assert (avoid.client, avoid.lives, avoid.on_time, avoid.late) == ("drive/avoid", True, 1, 1)
    assert [c.lives for c in after.clients] == [False, True, False]


def test_modules_in_python_are_watched_by_what_they_announce() -> None:
    stage = Stage(deployed(python_modules=("pulse",)))
    stage.ready()
    assert stage.ticks == []
    stage.ready(clients=("DServer/activity/pulse",))
    assert [t.run for t in stage.ticks] == ["run"]
    for k in range(3):
        stage.handle(Announcement(k=k, module="pulse", answer=Answer((300.0, 5.0))))
        stage.until(k * 50 * MS + 50 * MS)
    stage.until(500 * MS)
    assert stage.ticks[5].down == ()
    assert stage.ticks[9].down == ("DServer/activity/pulse",)
    assert SendMessage("DServer/fetches", Fetch(server="DServer/activity/pulse", k=3)) in stage.effects


# --- liveness ----------------------------------------------------------------------------------------


def test_liveness_ignores_strangers() -> None:
    liveness = Liveness(("a",), lease_ns=10, now_ns=0)
    liveness.renew("b", 100)
    assert liveness.missing(10) == ()
    assert liveness.missing(11) == ("a",)


def test_one_that_is_gone_is_missing_until_it_is_heard_of() -> None:
    liveness = Liveness(("a", "b"), lease_ns=10, now_ns=0)
    liveness.mark_missing("a")
    liveness.extend(5)
    assert liveness.missing(15) == ("a",)
    liveness.renew("a", 16)
    assert liveness.missing(16) == ("b",)


def test_a_lease_has_at_least_three_frames() -> None:
    assert lease(20 * MS) == 250 * MS
    assert lease(100 * MS) == 300 * MS


def test_a_frame_is_void_once() -> None:
    answers = TickAnswers(("a", "b"), frames_kept=10)
    for k in range(3):
        answers.tick_sent(k, ())
    answers.frame_received("a", 1, 0)
    answers.frame_received("stranger", 1, 0)
    assert answers.take_void(("a",)) == (("a", 0), ("a", 2))
    assert answers.take_void(("a",)) == ()
    assert list(answers.overdue(2)) == [("b", 0)]
    answers.frame_received("b", 2, 1)
    assert answers.take_void(()) == (("b", 0),)
    answers.clear()
    assert answers.take_void(("a", "b")) == ()


def test_no_more_is_waited_for_than_is_kept() -> None:
    answers = TickAnswers(("a",), frames_kept=3)
    for k in range(10):
        answers.tick_sent(k, ())
    assert answers.take_void(("a",)) == (("a", 7), ("a", 8), ("a", 9))


def test_a_tick_is_given_once_more_to_all_who_ask_between_two_ticks(stage: Stage) -> None:
    """Each goes to everybody: a flood of fetches must not breed."""
    stage.until(500 * MS)
    k = stage.ticks[-3].k
    assert [tick.k for tick in stage.fetched(k)] == [k]
    assert stage.fetched(k) == []
    assert sum(len(stage.fetched(k - back)) for back in range(1, 200)) < 100
    stage.pass_time(50 * MS)
    assert [tick.k for tick in stage.fetched(k)] == [k]


def test_the_interface_of_the_robot_can_be_read() -> None:
    served = interface_of(roam().robot)
    leader = Leader(Stage(interface=served), "user/1")
    assert msgspec.msgpack.decode(leader.ask(library.interface()).result, type=Interface) == served
    plain = Leader(Stage(), "user/1")
    assert msgspec.msgpack.decode(plain.ask(library.interface()).result, type=Interface) == Interface()
