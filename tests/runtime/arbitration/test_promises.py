"""What an arbiter should promise, and priority multiplexers do not: one test each, against RServer.

The titles after each name are what users of the best known multiplexer report, or what its sources show.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest

from colony.runtime.library import clock as clock_library
from colony.runtime.library import emergency, robot
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol import topics
from colony.runtime.protocol.calls import NoArguments
from colony.runtime.protocol.messages import Call, Malformed, Problem, SendMessage, Tick
from tests.kit.base import CLIENTS, Stage, bid, silent, stage_in_run
from tests.kit.calling import call_of
from tests.kit.node_stage import FRAME_NS, MS

IDLE = (0.0, 0.0)


def sent_by_frame(stage: Stage) -> dict[int, list[tuple[float, float]]]:
    found: dict[int, list[tuple[float, float]]] = {}
    for t_ns, velocity, turn in stage.base.told:
        found.setdefault(t_ns // FRAME_NS, []).append((velocity, turn))
    return found


@pytest.fixture
def stage() -> Stage:
    return stage_in_run()


def test_one_command_a_frame_however_many_want_to(stage: Stage) -> None:
    """Two sources at 20 Hz interleave; two sources never work together."""
    for i, priority in enumerate((9, 8, 7, 0)):
        stage.open(f"op/{i}", priority)
    for k in range(10):
        stage.tick()
        for i in range(4):
            stage.do(f"op/{i}", robot.drive(10.0 * (i + 1), float(k)))
        for request in (
            bid("back_off", -100.0, 0.0),
            bid("cruise", 300.0, 0.0),
            *silent("back_off", "cruise"),
        ):
            stage.handle(msgspec.structs.replace(request, k=stage.k))
    assert {k: len(commands) for k, commands in sent_by_frame(stage).items()} == dict.fromkeys(range(10), 1)
    assert [v.outside for v in stage.verdicts[1:]] == ["op/0"] * (len(stage.verdicts) - 1)


def test_silence_sends_the_safe_command_in_every_frame(stage: Stage) -> None:
    """Lock or expiry publishes nothing, and the base goes on with what it heard last."""
    stage.frame(*silent(), count=5)
    assert sent_by_frame(stage) == {k: [IDLE] for k in range(5)}


def test_an_expired_lease_of_the_network_is_the_next_frame(stage: Stage) -> None:
    """A command is valid for the frame that it was made for, and for no other."""
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    stage.tick()
    for request in silent("cruise"):
        stage.handle(msgspec.structs.replace(request, k=1))
    stage.handle(msgspec.structs.replace(bid("cruise", 300.0, 0.0), k=0))
    stage.until(2 * FRAME_NS - 1)
    assert sent_by_frame(stage)[1] == [IDLE]


@pytest.mark.parametrize("lease", [0.0, -1.0, math.inf, math.nan])
def test_freshness_is_finite(stage: Stage, lease: float) -> None:
    """`timeout: 0` never expires."""
    stage.open("op/1", priority=9)
    problem = stage.problem("op/1", robot.drive(100.0, 0.0, lease))
    assert problem.code == "arguments"
    assert "expected more than 0 and at most 60 s" in problem.message


def test_who_gives_way_sends_nothing_in_its_place(stage: Stage) -> None:
    """A joystick that is let go sends zeros until its time-out, and nobody else drives."""
    stage.open("op/1", priority=9)
    stage.do("op/1", robot.drive(100.0, 0.0, 60.0))
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"), count=2)
    stage.do("op/1", robot.give_way())
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    stage.do("op/1", robot.drive(100.0, 0.0, 60.0))
    stage.tick()
    stage.do("op/1", robot.give_way())  # that frame went out at its tick
    stage.do("op/1", robot.give_way())  # nothing is left to end
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    told = [verdict.values for verdict in stage.verdicts]
    assert told == [(100.0, 0.0), (100.0, 0.0), (300.0, 0.0), (100.0, 0.0), (300.0, 0.0)]
    move = stage.send("op/1", robot.move(500.0))
    stage.tick()
    stage.do("op/1", robot.give_way())
    assert stage.replies["op/1", move].problem == Problem(code="replaced", message="this connection gave way")


def test_speeds_that_are_taken_and_those_that_were_sent_are_reported(stage: Stage) -> None:
    stage.open("op/1", priority=9)
    stage.do("op/1", robot.drive(100.0, -20.0))
    stage.frame(*silent())
    found = stage.do("op/1", robot.arbitration())
    assert (found.low, found.high) == ((-300.0, -60.0, 0.0), (500.0, 60.0, 0.0))
    assert found.sent == (100.0, -20.0, 0.0)


def test_freshness_has_a_default() -> None:
    """A time-out that nobody thought of is not one without end."""
    stage = Stage()
    stage.open("op/1")
    stage.do("op/1", robot.drive(100.0, 0.0))
    stage.frame(count=20)
    assert len([v for v in stage.verdicts if v.outside]) == 10


def test_a_source_that_was_never_heard_takes_no_part(stage: Stage) -> None:
    """A source never heard, with the highest priority, starves all below it."""
    stage.open("op/1", priority=99)
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    assert (stage.verdicts[-1].by, stage.verdicts[-1].outside) == ("cruise", None)
    assert stage.do("op/1", robot.arbitration()).outside == ()


def test_leases_do_not_depend_on_what_ticks_say_of_the_time() -> None:
    """Age on a clock that may jump back."""
    stage = Stage()
    stage.open("op/1")
    stage.do("op/1", robot.drive(100.0, 0.0))
    for k in range(12):
        stage.until(k * FRAME_NS)
        stage.k = k
        stage.handle(Tick(k=k, t_ns=(k - 500 * (k % 2)) * FRAME_NS))
    assert [v.outside for v in stage.verdicts] == ["op/1"] * 10 + [None] * 2


def test_ties_among_connections_are_refused_by_name() -> None:
    """Ties go to the first listed, and the shipped sample has a tie."""
    stage = Stage()
    stage.open("op/1", priority=7, name="joystick")
    stage.open("op/2", priority=7)
    stage.do("op/1", robot.drive(100.0, 0.0))
    stage.frame(count=20)
    for ask in (robot.drive(50.0, 0.0), robot.go(50.0), robot.move(10.0), robot.stop(), robot.lock()):
        problem = stage.problem("op/2", ask)
        assert (problem.code, "joystick (op/1)" in problem.message) == ("tie", True)
    stage.close("op/1")
    stage.do("op/2", robot.drive(50.0, 0.0))


def test_ties_with_clients_of_the_program_are_refused_by_name(stage: Stage) -> None:
    """The same, where one of both is compiled in."""
    stage.open("op/1", priority=2)
    problem = stage.problem("op/1", robot.drive(50.0, 0.0))
    assert (problem.code, "`avoid`" in problem.message) == ("tie", True)


def test_any_number_may_read_and_stop_with_one_priority(stage: Stage) -> None:
    """A tie is one only among those who command."""
    for i in range(50):
        stage.open(f"op/{i}", priority=2)
        stage.do(f"op/{i}", robot.position())
    stage.do("op/7", emergency.stop())


def test_every_priority_is_as_it_was_given() -> None:
    """Priority silently clamped to 0-255, and 0 can never win."""
    stage = Stage()
    for number, priority in enumerate((-(10**9), -1, 0, 255, 256, 10**9)):
        connection = f"op/{number}"
        stage.open(connection, priority)
        stage.do(connection, robot.drive(float(number), 0.0, lease=5.0))
        stage.frame()
        assert stage.verdicts[-1].outside == connection
    assert [o.priority for o in stage.do("op/0", robot.arbitration()).outside] == [
        10**9,
        256,
        255,
        0,
        -1,
        -(10**9),
    ]


def test_idle_is_not_a_command_of_zero(stage: Stage) -> None:
    """Zero from a source and nobody commanding look the same."""
    stage.frame(bid("cruise", 0.0, 0.0), *silent("cruise"))
    stage.frame(*silent())
    assert [(v.by, v.values) for v in stage.verdicts] == [("cruise", IDLE), (None, IDLE)]
    stage.open("op/1", priority=9)
    stage.do("op/1", robot.drive(0.0, 0.0, lease=0.05))
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    assert (stage.verdicts[-1].outside, stage.verdicts[-1].values) == ("op/1", IDLE)


def test_every_frame_names_the_winner_and_why_each_other_lost(stage: Stage) -> None:
    """No word of who won or why."""
    stage.open("op/1", priority=9)
    stage.open("op/2", priority=0)
    stage.do("op/2", robot.drive(5.0, 0.0, lease=10.0))
    stage.frame(bid("avoid", 60.0, 0.0), bid("cruise", bid="suppressed"), bid("back_off", bid="silent"))
    stage.do("op/1", robot.drive(10.0, 0.0, lease=0.04))
    stage.frame(bid("avoid", 60.0, 0.0), bid("cruise", bid="inhibited"), bid("back_off", bid="silent"))
    stage.frame(*silent("back_off"), lost=("drive/back_off",))
    stage.tick()
    assert [(v.by, v.outside, dict(v.fates)) for v in stage.verdicts] == [
        (
            "avoid",
            None,
            {"back_off": "silent", "avoid": "won", "cruise": "suppressed", "op/2": "overridden"},
        ),
        (
            None,
            "op/1",
            {"back_off": "silent", "avoid": "overridden", "cruise": "inhibited", "op/2": "overridden"},
        ),
        (None, None, {"back_off": "lost", "avoid": "silent", "cruise": "silent", "op/2": "overridden"}),
    ]


def test_a_lesser_command_does_not_act_where_a_higher_one_is_unknown() -> None:
    """The source below takes over when the one above dies."""
    for lost in ((), ("drive/back_off",)):
        stage = stage_in_run()
        stage.open("op/1", priority=0)
        stage.do("op/1", robot.drive(100.0, 0.0, lease=5.0))
        stage.frame(*silent("back_off"), lost=lost)
        assert sent_by_frame(stage)[0] == [IDLE]


def test_a_lock_fails_safe() -> None:
    """A lock whose holder died is released, or stays for ever."""
    stage = Stage()
    stage.open("op/1", priority=9)
    stage.open("op/2", priority=8)
    stage.do("op/1", robot.lock())
    stage.do("op/1", robot.drive(100.0, 0.0, lease=60.0))
    stage.frame()
    stage.die("op/1")
    stage.frame(count=20)
    assert stage.base.velocity == 0.0
    stage.do("op/2", robot.drive(10.0, 0.0))


def test_what_is_wrong_is_said_to_whom_it_concerns() -> None:
    """A misspelled topic or field does nothing, without a word."""
    stage = Stage()
    stage.open("op/1")
    unknown = stage.problem("op/1", CallRequest("drvie", NoArguments(), type(None), "command"))
    assert "no method `drvie`" in unknown.message
    assert "drive" in unknown.message
    stage.handle(Malformed(topic="RServer/call", connection="op/1", reason="found version 9"))
    problem = stage.replies["op/1", 0].problem
    assert problem.message == "RServer: found version 9"


def test_malformed_requests_move_nothing_and_are_told(stage: Stage) -> None:
    """What cannot be read is dropped without a word."""
    stage.frame(bid("cruise", 9999.0, 0.0), bid("stranger", 1.0, 1.0), *silent("cruise"))
    assert sent_by_frame(stage) == {0: [IDLE]}
    (verdict,) = stage.verdicts
    assert dict(verdict.fates)["cruise"] == "refused"
    assert verdict.notes == ("`cruise` gave velocity = 9999.0", "`stranger` is not a client of drive")


# --- emergency stop --------------------------------------------------------------------------------


def urgent(connection: str, **changes: Any) -> Call:
    return msgspec.structs.replace(call_of(emergency.stop(), connection), **changes)


def test_an_emergency_stop_acts_at_once_and_on_everybody(stage: Stage) -> None:
    """There is none; or it is one more source with a priority."""
    stage.open("op/1", priority=9)
    stage.open("op/2", priority=-5)
    stage.do("op/1", robot.drive(100.0, 0.0, lease=5.0))
    stage.do("op/1", robot.lock())
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    stage.pass_time(1)
    before = len(stage.base.told)
    stage.do("op/2", emergency.stop())
    assert stage.base.velocity == 0.0
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"), count=5)
    assert len(stage.base.told) == before
    assert len([t for t in stage.base.stops if t >= 2 * FRAME_NS]) >= 4
    verdict = stage.verdicts[-1]
    assert (verdict.hold, verdict.values) == ("stopped", IDLE)
    assert dict(verdict.fates)["cruise"] == "stopped"
    for ask in (robot.drive(1.0, 0.0), robot.go(1.0), robot.move(1.0), robot.lock()):
        assert stage.problem("op/1", ask).code == "stopped"


def test_after_the_release_the_network_goes_on_and_nobody_else_does(stage: Stage) -> None:
    """A command from before the stop comes back to life."""
    stage.open("op/1", priority=9)
    stage.do("op/1", robot.drive(100.0, 0.0, lease=60.0))
    stage.frame(*silent())
    stage.do("op/1", emergency.stop())
    stage.frame(*silent())
    stage.release()
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    assert (stage.verdicts[-1].by, stage.verdicts[-1].outside) == ("cruise", None)
    assert "the emergency stop was released" in stage.verdicts[-1].notes


@pytest.mark.parametrize(
    "call",
    [
        urgent("op/1"),
        urgent("op/1", right="command"),
        urgent("op/1", priority=77),
        urgent("op/1", arguments=msgspec.Raw(b"\xc1nonsense")),
        urgent("nobody/9"),
        urgent("nobody/9", priority=3, arguments=msgspec.Raw(b"")),
    ],
    ids=["right", "more right", "priority", "arguments", "not open", "nothing right but the name"],
)
def test_an_emergency_stop_gets_through_whatever_else_is_wrong(stage: Stage, call: Call) -> None:
    """The stop needs a connection, a priority, a format."""
    stage.open("op/2", priority=9)
    stage.do("op/2", robot.lock())
    stage.open("op/1")
    call = msgspec.structs.replace(call, number=2)
    stage.handle(call)
    assert stage.replies[call.connection, 2].problem is None
    stopped = stage.do("op/2", robot.arbitration()).stopped
    assert stopped.by == call.connection


def test_only_who_may_stop_stops(stage: Stage) -> None:
    """Anyone on the network may publish to the stop topic."""
    for connection in ("op/1", "nobody/9"):
        stage.handle(urgent(connection, right="read"))
        problem = stage.replies[connection, 1].problem
        assert problem is not None
    stage.open("op/2")
    assert stage.do("op/2", robot.arbitration()).stopped is None


def test_nobody_releases_at_the_server(stage: Stage) -> None:
    """Any server lifts the stop for itself."""
    stage.open("op/1")
    stage.do("op/1", emergency.stop())
    assert stage.problem("op/1", clock_library.release()).code == "method"
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"), count=3)
    assert stage.base.told == []


def test_a_stop_that_one_server_heard_survives_a_restart_of_that_server() -> None:
    """After a restart everything is as if nothing had happened."""
    first = stage_in_run()
    first.open("op/1")
    first.do("op/1", emergency.stop())
    first.tick()
    stage = stage_in_run()
    stage.latch = first.latch
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"), count=3)
    assert stage.base.told == []
    assert stage.verdicts[-1].hold == "stopped"
    stage.open("op/2")
    assert stage.do("op/2", robot.arbitration()).stopped.by == "op/1"
    stage.release()
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    assert stage.base.velocity == 300.0


# --- those who die ---------------------------------------------------------------------------------


def test_a_frozen_connection_is_stopped_by_its_lease() -> None:
    """Client frozen: the robot drives on."""
    stage = Stage()
    stage.open("op/1")
    stage.do("op/1", robot.drive(100.0, 0.0))
    stage.frame()
    stage.die("op/1")
    stage.frame(count=11)
    assert stage.base.velocity == 0.0
    assert sent_by_frame(stage)[10] == [IDLE]


def test_a_dead_connection_loses_its_motion_within_a_second() -> None:
    """What has no lease of its own lives as long as its connection."""
    stage = Stage()
    stage.open("op/1")
    stage.send("op/1", robot.move(100_000.0, 100.0))
    stage.frame(count=10)
    stage.die("op/1")
    stage.frame(count=20)
    assert stage.base.velocity == 0.0
    assert ("op/1", 0) in stage.replies


def test_one_dead_client_of_the_network_does_not_stop_the_others_for_good(stage: Stage) -> None:
    """One client's death stops the robot and the data of the others."""
    stage.frame(bid("avoid", 60.0, 0.0), *silent("avoid", "cruise"), count=3, lost=("drive/cruise",))
    assert stage.base.velocity == 60.0
    assert [v.by for v in stage.verdicts] == ["avoid"] * 3


def test_verdicts_go_to_everybody_who_listens(stage: Stage) -> None:
    """Commands are not logged."""
    stage.tick()
    effects = [e for client, _ in CLIENTS for e in stage.node.handle(bid(client, bid="silent"), MS)]
    (sent,) = [e for e in effects if isinstance(e, SendMessage)]
    assert (sent.topic, sent.message.k) == (topics.VERDICTS, 0)
