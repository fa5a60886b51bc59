"""The Clock at the edges: the first moment, the end of a lease, two things at one time, nothing to do."""

from __future__ import annotations

from typing import get_args

import msgspec
import pytest

from colony.ir.frame import Answer
from colony.ir.program import Actuator, Program
from colony.runtime.frames.clock import IDLE_FRAME_NS, READY_TIMEOUT_NS, Clock
from colony.runtime.frames.registry import ClientRegistry, Liveness, TickAnswers
from colony.runtime.library import clock as library
from colony.runtime.protocol import topics
from colony.runtime.protocol.deployment import READ_ONLY, Deployment
from colony.runtime.protocol.messages import (
    Announcement,
    Fate,
    Fetch,
    Ready,
    Restart,
    SendMessage,
    ServerFrame,
    Wake,
    WakeAt,
)
from tests.kit.clock import CLIENTS, Leader, Stage, deployed, verdict
from tests.kit.node_stage import MS
from tests.runtime.programs import drive, roam, robot


def two_actuators() -> Program:
    arm = Actuator(name="arm", fields=(drive().fields[0],), server="DServer", command="arm", idle=None)
    return roam(robot=robot(actuators=(arm,)))


def times(stage: Stage, run: str | None = None) -> list[float]:
    """Of the frames, in ms."""
    return [t.t_ns / MS for t in stage.ticks if run is None or t.run == run]


# --- who lives ---------------------------------------------------------------------------------------


def test_who_was_never_heard_of_is_down_only_when_the_lease_is_over(stage: Stage) -> None:
    stage.until(300 * MS, answering=())
    assert [t.down for t in stage.ticks] == [()] * 6 + [("PServer", "RServer")]


def test_what_the_program_reads_besides_is_watched_too() -> None:
    stage = Stage(msgspec.structs.replace(deployed(), servers=("DServer", "RServer")))
    stage.ready()
    stage.until(300 * MS)
    assert stage.ticks[-1].down == ("DServer",)
    assert [s.server for s in Leader(stage, "me/1").who().servers] == ["PServer", "RServer", "DServer"]


def test_a_request_for_the_first_frame_is_a_sign_of_life() -> None:
    stage = Stage(deployed())
    stage.ready()
    stage.until(200 * MS)
    stage.handle(Ready(client=CLIENTS[0], run="run", k=0))
    stage.until(400 * MS)
    assert stage.ticks[-1].lost == CLIENTS[1:]


def test_nobody_is_lost_before_the_run_begins() -> None:
    stage = Stage(deployed())
    leader = Leader(stage, "me/1")
    stage.until(200 * MS)
    assert all(c.lives for c in leader.who().clients)
    stage.until(600 * MS)
    assert {t.lost for t in stage.ticks} == {()}
    assert not any(c.lives for c in leader.who().clients)


def test_who_announces_is_waited_for_as_long_as_the_clients() -> None:
    stage = Stage(deployed(python_modules=("pulse",)))
    stage.until(1000 * MS)
    assert stage.ticks[-1].down == ("DServer/activity/pulse",)
    stage.ready(clients=(*CLIENTS, "DServer/activity/pulse"))
    stage.until(1100 * MS)
    assert (stage.ticks[-1].run, stage.ticks[-1].down) == ("run", ())


def test_what_is_announced_is_not_asked_for_and_what_is_not_is() -> None:
    stage = Stage(deployed(python_modules=("pulse",)))
    stage.ready(clients=(*CLIENTS, "DServer/activity/pulse"))
    for k in range(20):
        if k not in (0, 4):
            stage.handle(Announcement(k=k, module="pulse", answer=Answer()))
        stage.until((k + 1) * 50 * MS)
    asked = [e for e in stage.effects if isinstance(e, SendMessage) and isinstance(e.message, Fetch)]
    assert {(s.topic, s.message.server) for s in asked} == {("DServer/fetches", "DServer/activity/pulse")}
    assert {s.message.k for s in asked} == {0, 4}
    assert {t.down for t in stage.ticks} == {()}
    assert {t.void for t in stage.ticks} == {()}


def test_after_a_run_the_servers_are_not_down(stage: Stage) -> None:
    leader = Leader(stage, "me/1")
    leader.deploy(deployed())
    stage.ready()
    stage.until(100 * MS)
    leader.close()
    stage.until(300 * MS)
    assert stage.ticks[-1].run == ""
    assert {t.down for t in stage.ticks} == {()}


def test_clients_of_slow_frames_have_longer_to_send_a_request() -> None:
    stage = Stage(deployed(program=roam(robot=robot(frame_ms=400))))
    stage.ready()
    stage.until(1200 * MS)
    assert [t.lost for t in stage.ticks] == [()] * 4
    stage.until(1600 * MS)
    assert stage.ticks[-1].lost == CLIENTS


def test_a_clock_that_was_stopped_blames_no_client() -> None:
    stage = Stage(deployed())
    stage.ready()
    stage.until(100 * MS)
    stage.now_ns = 5000 * MS
    stage.handle(Wake())
    assert stage.ticks[-1].t_ns == 5000 * MS
    assert (stage.ticks[-1].lost, stage.ticks[-1].down) == ((), ())


# --- when --------------------------------------------------------------------------------------------


def test_a_tick_that_is_kept_is_sent_to_all_frames_of_the_clock(stage: Stage) -> None:
    stage.until(100 * MS)
    stage.fetched(1)
    assert stage.effects[-1] == SendMessage("Clock/frames", stage.ticks[1])


def test_a_run_begins_after_the_frame_of_the_same_moment() -> None:
    for before_ns in (0, 100 * MS):
        stage = Stage()
        stage.until(before_ns)
        leader = Leader(stage, "me/1")
        leader.deploy(deployed())
        stage.ready()
        assert stage.ticks[-1].t_ns == before_ns
        stage.until(before_ns + 1)
        assert [t.t_ns for t in stage.ticks if t.run == "run"] == [before_ns + 1]


def test_a_run_that_is_there_from_the_beginning_begins_at_once() -> None:
    stage = Stage(deployed(), now_ns=70 * MS)
    stage.ready()
    assert [(t.run, t.t_ns) for t in stage.ticks] == [("run", 70 * MS)]


def test_waiting_ends_between_two_frames_too(stage: Stage) -> None:
    stage.until(70 * MS)
    leader = Leader(stage, "me/1")
    leader.deploy(deployed())
    while stage.now_ns < 70 * MS + READY_TIMEOUT_NS:
        leader.alive()
        stage.pass_time(100 * MS)
    assert times(stage, "run") == [(70 * MS + READY_TIMEOUT_NS) / MS]


def test_deploying_does_not_delay_the_frames_that_there_are(stage: Stage) -> None:
    stage.now_ns = 10 * MS
    Leader(stage, "me/1").deploy(deployed())
    stage.until(100 * MS)
    assert times(stage) == [0, 50, 100]


def test_when_the_leader_goes_the_next_frame_comes_when_it_was_due(stage: Stage) -> None:
    leader = Leader(stage, "me/1")
    leader.deploy(deployed())
    stage.until(10 * MS)
    stage.ready()
    stage.until(130 * MS)
    leader.close()
    assert times(stage, "run") == [10, 60, 110]
    stage.until(220 * MS)
    assert times(stage)[-2:] == [160, 210]


def test_when_the_leader_of_slow_frames_goes_nobody_waits_for_one_of_those(stage: Stage) -> None:
    leader = Leader(stage, "me/1")
    leader.deploy(deployed(program=roam(robot=robot(frame_ms=400))))
    stage.until(10 * MS)
    stage.ready()
    stage.until(100 * MS)
    leader.close()
    stage.until(100 * MS + IDLE_FRAME_NS - 1)
    assert stage.ticks[-1].run == "run"
    stage.until(100 * MS + IDLE_FRAME_NS)
    assert (stage.ticks[-1].run, stage.ticks[-1].t_ns) == ("", 100 * MS + IDLE_FRAME_NS)


def test_a_wake_is_asked_for_once(stage: Stage) -> None:
    known = len(stage.wakes)
    for _ in range(3):
        stage.handle(ServerFrame(server="PServer", k=0, fields={}), verdict(9))
    assert len(stage.wakes) == known
    effects = list(stage.node.handle(Wake(), 50 * MS))
    assert [e for e in effects if isinstance(e, WakeAt)] == [WakeAt(100 * MS)]


# --- lockstep ----------------------------------------------------------------------------------------


def test_in_lockstep_all_actuators_have_to_decide() -> None:
    stage = Stage(deployed(program=two_actuators(), lockstep=True))
    stage.ready()
    stage.now_ns = 1 * MS
    stage.handle(verdict(0), verdict(0))
    assert len(stage.ticks) == 1
    stage.handle(msgspec.structs.replace(verdict(0), actuator="arm"))
    assert times(stage) == [0, 50]


def test_before_a_run_in_lockstep_frames_are_at_whole_periods(stage: Stage) -> None:
    Leader(stage, "me/1").deploy(deployed(lockstep=True))
    for at in (57, 103):
        stage.now_ns = at * MS
        stage.handle(Wake())
    assert times(stage) == [0, 50, 100]


# --- runs and who leads them -------------------------------------------------------------------------


def test_who_without_a_program(stage: Stage) -> None:
    found = Leader(stage, "me/1").who()
    assert (found.run, found.program, found.leader, found.begun) == ("", "", None, False)
    assert (found.clients, found.restarts, found.frame_ns) == ((), 0, IDLE_FRAME_NS)


def test_who_before_the_first_frame() -> None:
    found = Leader(Stage(deployed()), "me/1").who()
    assert (found.k, found.t_ns, found.restarts, found.begun, found.run) == (-1, 0, 0, False, "run")


def test_it_listens_to_all_that_it_understands() -> None:
    clock = Clock(servers=("PServer",), frames_kept=3)
    assert {
        *(topics.fetches("Clock"), topics.announcements("DServer"), topics.frames("PServer")),
        topics.calls("Clock"),
        *(topics.READY, topics.RESTARTS, topics.VERDICTS, topics.ANSWERS),
    } <= {*clock.listens}
    assert not [topic for topic in clock.listens if "None" in topic]


def test_a_refusal_names_the_clock_and_the_leader(stage: Stage) -> None:
    Leader(stage, "me/1").deploy(deployed("a"))
    problem = Leader(stage, "you/1").ask(library.deploy(deployed("b"))).problem
    assert problem.message == "Clock is in the run `a`, which me/1 leads"


def test_a_robot_that_is_read_only_takes_no_program() -> None:
    stage = Stage(servers=(), read_only=True)
    leader = Leader(stage, "me/1")
    problem = leader.ask(library.deploy(deployed())).problem
    assert problem.message == READ_ONLY
    assert leader.who().read_only
    stage.until(100 * MS)
    assert {t.run for t in stage.ticks} == {""}


def test_restarts_are_those_in_the_middle_of_a_run(stage: Stage) -> None:
    leader = Leader(stage, "me/1")
    leader.deploy(deployed())
    stage.ready()
    stage.until(100 * MS)
    assert leader.who().restarts == 0
    for count in (1, 2):
        stage.handle(Restart(client=CLIENTS[0], start=stage.ticks[-1].start))
        stage.pass_time(50 * MS)
        assert leader.who().restarts == count


def test_to_lead_what_runs_already_changes_nothing() -> None:
    heard: list[Deployment] = []
    stage = Stage(deployed(), servers=("PServer",), on_deploy=heard.append)
    stage.ready()
    stage.until(100 * MS, answering=("PServer",))
    assert Leader(stage, "me/1").deploy(deployed()) is None
    stage.until(200 * MS, answering=("PServer",))
    assert {(t.run, t.start) for t in stage.ticks} == {("run", 0)}
    assert heard == []


def test_a_leader_may_go_on_to_another_run_of_which_is_told() -> None:
    heard: list[Deployment] = []
    stage = Stage(servers=(), on_deploy=heard.append)
    leader = Leader(stage, "me/1")
    for run in ("a", "b"):
        assert leader.deploy(deployed(run)) is None
        stage.ready(run)
        stage.until(stage.now_ns + 100 * MS, answering=())
        assert stage.ticks[-1].run == run
    assert [d.run for d in heard] == ["a", "b"]


# --- the registry, and what servers answered -------------------------------------------------------------


def test_the_registry_counts_fates() -> None:
    registry = ClientRegistry(("drive/a", "drive/b"), lease_ns=10, now_ns=0)
    registry.record_verdict(verdict(0, ("a", "won"), ("b", "late")), 0)
    registry.record_verdict(verdict(0, ("a", "lost"), ("b", "lost")), 0)
    registry.record_verdict(verdict(0, ("a", "silent"), ("b", "late")), 0)
    assert [(c.client, c.on_time, c.late) for c in registry.statuses(0)] == [
        ("drive/a", 2, 0),
        ("drive/b", 0, 2),
    ]


@pytest.mark.parametrize("fate", get_args(Fate))
def test_a_verdict_renews_the_lease_of_a_client_whose_request_came(fate: Fate) -> None:
    registry = ClientRegistry(("drive/a", "drive/b"), lease_ns=10, now_ns=0)
    registry.record_verdict(verdict(0, ("a", fate)), 8)
    unheard = fate in ("late", "lost", "refused")
    assert registry.lost(15) == (("drive/a", "drive/b") if unheard else ("drive/b",))


def test_who_is_not_ready_when_a_run_begins_is_lost_at_once() -> None:
    registry = ClientRegistry(("a", "b"), ("c",), lease_ns=10, now_ns=0)
    registry.mark_ready("b")
    registry.mark_ready("stranger")
    assert not registry.all_ready
    registry.begin(5)
    assert registry.lost(5) == ("a",)
    assert registry.lost(15) == ("a",)
    assert registry.lost(16) == ("a", "b")
    assert ("c" in registry, "a" in registry, "stranger" in registry) == (True, True, False)


def test_the_lease_includes_its_last_moment() -> None:
    liveness = Liveness(("a", "b"), lease_ns=10, now_ns=3)
    assert liveness.missing(13) == ()
    assert liveness.missing(14) == ("a", "b")
    liveness.extend(4)
    assert liveness.missing(17) == ()
    assert liveness.missing(18) == ("a", "b")


def test_a_server_gives_up_only_frames_before_those_that_it_knows() -> None:
    answers = TickAnswers(("a",), frames_kept=10)
    for k in range(4):
        answers.tick_sent(k, ())
    answers.frame_received("a", 3, 2)
    assert answers.take_void(()) == (("a", 0), ("a", 1))
    assert list(answers.overdue(4)) == [("a", 2)]
    answers.frame_received("a", 9, 2)
    assert answers.take_void(()) == ()
    assert answers.take_void(("stranger",)) == ()


def test_frames_are_asked_for_when_they_are_two_four_and_eight_ticks_old() -> None:
    answers = TickAnswers(("a", "b"), frames_kept=10)
    for k in range(10):
        answers.tick_sent(k, ("b",) if k < 6 else ())
    assert list(answers.overdue(10)) == [("a", 8), ("a", 6), ("a", 2), ("b", 8), ("b", 6)]
    assert list(answers.overdue(1)) == []
    answers.frame_received("a", 6, 0)
    assert list(answers.overdue(10)) == [("a", 8), ("a", 2), ("b", 8), ("b", 6)]


def test_a_server_that_is_far_behind_is_not_asked_more() -> None:
    answers = TickAnswers(("a",), frames_kept=2000)
    for k in range(5000):
        answers.tick_sent(k, ())
    assert len(list(answers.overdue(5000))) == 10
