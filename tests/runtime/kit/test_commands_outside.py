"""Connections that command an actuator of a server written with the kit, beside a program and without one."""

from __future__ import annotations

import math
from typing import Any

import pytest
from msgspec import structs

from colony.runtime.kit.fields import FieldReader, field
from colony.runtime.kit.service import Service, method
from colony.runtime.library import actuator, emergency
from colony.runtime.library.ask import Ask
from colony.runtime.library.clock import deploy
from colony.runtime.protocol.calls import NoArguments
from colony.runtime.protocol.messages import Bounds, Effect, Stopped
from colony.runtime.servers.outside_control import CLOCK_GRACE_NS
from tests.kit.calling import call_of
from tests.kit.lift import (
    FAST,
    HEIGHT,
    HOLDING,
    LIFT,
    Lift,
    Stage,
    frames,
    program,
    verdicts,
)
from tests.kit.node_stage import FRAME_NS, MS, Caller

LIMITED = structs.replace(LIFT, limited=True)


def to(height: float, fast: bool = True, lease: float = 10.0) -> Ask[None]:
    return actuator.command("move", {"height": height, "fast": fast}, lease)


def bounds(k: int, low: float = 0.0, high: float = 250.0, **options: Any) -> Bounds:
    return Bounds(k=k, actuator="lift", low=(low, None), high=(high, None), **options)


# --- priorities ------------------------------------------------------------------------------------------


def test_a_connection_above_the_modules_commands_in_their_place_and_one_below_while_they_are_idle() -> None:
    for priority, decided in ((50, (100.0, True)), (0, (300.0, True))):
        stage = Stage(program())
        eve = stage.connect("eve/1", priority)
        eve.do(to(100.0))
        [verdict] = verdicts(stage.decide(1, 300.0, True))
        assert stage.take() == [decided]
        outside = priority == 50
        assert (verdict.by, verdict.outside, verdict.values) == (
            (None, "eve/1", decided) if outside else ("up", None, decided)
        )
        assert verdict.fates == (
            ("up", "overridden" if outside else "won"),
            ("down", "inactive"),
            *(() if outside else (("eve/1", "overridden"),)),
        )
        [verdict] = verdicts(stage.decide(2))
        assert stage.take() == [(100.0, True)], "as nobody else commands"
        assert verdict.outside == "eve/1"


def test_what_a_connection_commanded_is_last_in_the_next_frame() -> None:
    stage = Stage(program())
    stage.connect("eve/1", 50).do(to(100.0))
    stage.decide(1, 300.0, True)
    [frame] = frames(stage.tick(2))
    sent = {name: sample and sample.value for name, sample in frame.fields.items()}
    assert sent == {"height": 7.0, "last.lift.height": 100.0, "last.lift.fast": True}


def test_a_program_with_the_priority_of_a_connection_is_refused() -> None:
    stage = Stage()
    stage.leader.open("leader")
    stage.tick(1, run="")
    stage.connect("eve/1", 2).do(to(100.0))
    problem = stage.leader.problem(deploy(program()))
    assert (problem.code, problem.message) == (
        "tie",
        "Lift.deploy: `up` has priority 2, with which eve (eve/1) commands",
    )


# --- leases ----------------------------------------------------------------------------------------------


def test_a_command_ends_with_its_lease_unless_it_is_repeated() -> None:
    stage = Stage(program())
    eve = stage.connect("eve/1", 50)
    eve.do(to(100.0, lease=0.12))
    for k in range(1, 5):
        stage.decide(k)
    assert stage.take() == [(100.0, True)] * 2 + [(0.0, False)] * 2
    eve.do(to(110.0, lease=0.12))
    stage.decide(5)
    eve.do(to(110.0, lease=0.12))
    stage.decide(6)
    stage.decide(7)
    stage.decide(8)
    assert stage.take() == [(110.0, True)] * 3 + [(0.0, False)]


def test_a_command_ends_with_its_connection() -> None:
    stage = Stage(program())
    eve = stage.connect("eve/1", 50)
    eve.do(to(100.0))
    stage.decide(1)
    eve.close()
    stage.decide(2)
    eve = stage.connect("eva/1", 50)
    eve.do(to(120.0))
    stage.decide(3)
    stage.pass_time(800 * MS)  # without a sign of life
    stage.decide(20)
    assert stage.take()[-1] == (0.0, False)
    assert verdicts(stage.decide(21))[0].outside is None


def test_where_the_program_holds_the_device_is_made_safe_when_a_command_of_a_connection_ends() -> None:
    stage = Stage(program("run", HOLDING))
    stage.decide(1, 300.0, True)
    stage.decide(2)
    assert stage.take() == [(300.0, True)], "what the program commanded holds"
    eve = stage.connect("eve/1", 50)
    eve.do(to(100.0))
    stage.decide(3)
    eve.close()
    stage.decide(4)
    stage.decide(5)
    assert stage.take() == [(100.0, True), "safe"]


# --- locks -----------------------------------------------------------------------------------------------


def test_the_holder_of_the_lock_alone_commands() -> None:
    stage = Stage(program())
    eve, bob = stage.connect("eve/1", 50), stage.connect("bob/1", 60)
    bob.do(to(200.0))
    eve.do(actuator.lock())
    assert bob.refusal(to(200.0)) == "locked"
    [verdict] = verdicts(stage.decide(1, 300.0, True))
    assert stage.take() == [(0.0, False)]
    assert (verdict.hold, verdict.fates) == ("locked", (("up", "locked out"), ("down", "inactive")))
    eve.do(to(100.0))
    stage.decide(2, 300.0, True)
    assert stage.take() == [(100.0, True)]
    assert bob.refusal(actuator.unlock()) == "unlocked"
    assert bob.replies(bob.begin(actuator.lock())) == [], "it waits"
    eve.close()
    bob.do(to(200.0))
    bob.do(actuator.unlock())
    bob.close()
    stage.decide(3, 300.0, True)
    assert stage.take() == [(300.0, True)]


def test_a_call_that_waits_for_the_lock_in_vain_is_refused() -> None:
    stage = Stage(program())
    eve, bob = stage.connect("eve/1", 50), stage.connect("bob/1", 60)
    eve.do(actuator.lock())
    assert bob.refusal(actuator.lock(wait=False)) == "locked"
    assert bob.replies(bob.begin(actuator.lock(wait_s=0.2))) == []
    [reply] = bob.replies(stage.pass_time(250 * MS))
    assert reply.problem.code == "locked"


def test_a_lock_makes_the_device_of_a_program_that_holds_safe() -> None:
    stage = Stage(program("run", HOLDING))
    stage.decide(1, 300.0, True)
    stage.connect("eve/1", 50).do(actuator.lock())
    stage.decide(2, 310.0, True)
    stage.decide(3, 320.0, True)
    assert stage.take() == [(300.0, True), "safe"]


# --- limits ----------------------------------------------------------------------------------------------


def limited(actuator_spec: Any = LIMITED, priority: int = 50) -> tuple[Stage, Caller]:
    stage = Stage(program("run", actuator_spec))
    eve = stage.connect("eve/1", priority)
    eve.do(to(400.0))
    return stage, eve


def bounded(stage: Stage, k: int, *given: Bounds) -> list[Effect]:
    return [*stage.decide(k), *stage.handle(*given)]


def test_a_command_is_held_to_the_bounds_of_its_frame() -> None:
    stage, _ = limited()
    [verdict] = verdicts(bounded(stage, 1, bounds(1)))
    assert stage.take() == [(250.0, True)]
    assert (verdict.outside, verdict.values, verdict.unlimited) == ("eve/1", (250.0, True), False)
    bounded(stage, 2, bounds(2, high=180.0))
    assert stage.take() == [(180.0, True)]


def test_where_the_bounds_do_not_come_the_actuator_is_idle_or_safe() -> None:
    for spec, instead in ((LIMITED, (0.0, False)), (structs.replace(LIMITED, idle=None), "safe")):
        stage, _ = limited(spec)
        bounded(stage, 1, bounds(1))
        stage.decide(2)
        [verdict] = verdicts(stage.pass_time(40 * MS))
        assert stage.take() == [(250.0, True), instead]
        assert verdict.fault == "limits unknown"


def test_a_connection_may_ignore_the_limits_but_not_the_ranges() -> None:
    stage, eve = limited()
    eve.do(actuator.ignore_limits())
    [verdict] = verdicts(stage.decide(1))
    assert stage.take() == [(400.0, True)]
    assert verdict.unlimited
    assert eve.refusal(to(401.0)) == "arguments"
    eve.do(actuator.ignore_limits(False))
    bounded(stage, 2, bounds(2))
    assert stage.take() == [(250.0, True)]


def test_the_command_ends_with_the_run_whose_limits_held_it() -> None:
    for end in ("leader", "clock", "other"):
        stage, _ = limited()
        bounded(stage, 1, bounds(1))
        if end == "leader":
            stage.leader.close()
            stage.tick(2)
        elif end == "clock":
            stage.tick(2, run="")
        else:
            stage.leader.do(deploy(program("next")))
            stage.tick(2, run="next")
        stage.pass_time(40 * MS)
        assert set(stage.take()[1:]) == {(0.0, False)}, end


# --- without a program -----------------------------------------------------------------------------------


def test_without_a_program_a_connection_commands_within_the_range_of_the_command() -> None:
    stage = Stage()
    eve = stage.connect("eve/1", 0)
    eve.do(to(100.0, lease=0.12))
    effects = stage.tick(1, run="")
    assert stage.take() == [(100.0, True)]
    [verdict] = verdicts(effects)
    assert (verdict.actuator, verdict.outside, verdict.values) == ("move", "eve/1", (100.0, True))
    assert eve.refusal(to(401.0)) == "arguments"
    stage.tick(2, run="")
    stage.tick(3, run="")
    stage.tick(4, run="")
    assert stage.take() == [(100.0, True), "safe"], "when the lease is over"


def test_the_run_begins_and_ends_while_a_connection_commands() -> None:
    stage = Stage()
    eve = stage.connect("eve/1", 50)
    eve.do(to(100.0))
    stage.tick(1, run="")
    stage.leader.open("leader")
    stage.leader.do(deploy(program()))
    stage.tick(2, run="")
    assert stage.take() == [(100.0, True), "safe"], "as the program is deployed, and has not begun"
    stage.decide(3, 300.0, True)
    assert stage.take() == [(100.0, True)]
    stage.leader.close()
    stage.tick(4, run="")
    assert stage.take() == [(0.0, False), (100.0, True)]


def test_a_program_forgets_what_it_sent_before_a_connection_commanded_without_it() -> None:
    stage = Stage(program())
    eve = stage.connect("eve/1", 50)
    stage.decide(1, 300.0, True)
    stage.leader.close()
    stage.tick(2, run="")
    eve.do(to(100.0, lease=0.06))
    stage.tick(3, run="")
    stage.tick(4, run="")
    [frame] = frames(stage.tick(5))
    assert "last.lift.height" not in frame.fields, "which is not 300, nor the idle command after it"
    assert stage.take() == [(300.0, True), (0.0, False), (100.0, True), "safe"]


def test_in_frames_of_another_run_nobody_commands() -> None:
    stage = Stage()
    eve = stage.connect("eve/1", 50)
    eve.do(to(100.0))
    stage.tick(1, run="")
    stage.tick(2, run="another")
    stage.tick(3, run="another")
    assert stage.take() == [(100.0, True), "safe"]


def test_commands_for_which_the_program_has_no_actuator_are_free() -> None:
    stage = Stage(program("run", structs.replace(LIFT, server="Other")))
    stage.connect("eve/1", 50).do(to(100.0))
    assert verdicts(stage.tick(1)) == []
    assert stage.take() == [(100.0, True)]


def test_a_command_that_the_range_of_a_program_narrows_is_held_to_it() -> None:
    narrow = structs.replace(LIFT, fields=(structs.replace(HEIGHT, high=200.0), FAST))
    stage = Stage()
    stage.connect("eve/1", 50).do(to(300.0))
    stage.tick(1, run="")
    stage.leader.open("leader")
    stage.leader.do(deploy(program("run", narrow)))
    stage.decide(2)
    assert stage.take() == [(300.0, True), (200.0, True)]


# --- values ----------------------------------------------------------------------------------------------

WRONG: list[tuple[dict[str, Any], str]] = [
    ({"height": 100.0}, "Lift.move: fast is missing"),
    ({"height": 100.0, "fast": 1.0}, "Lift.move: fast = 1.0; expected a bool"),
    ({"height": True, "fast": True}, "Lift.move: height = True; expected a finite number"),
    ({"height": math.nan, "fast": True}, "Lift.move: height = nan; expected a finite number"),
    ({"height": 401.0, "fast": True}, "Lift.move: height = 401.0; expected 0 to 400"),
    ({"height": 1.0, "fast": True, "hight": 1.0}, "found `hight`; its parameters are height, fast"),
]


@pytest.mark.parametrize(("values", "reason"), WRONG)
def test_values_that_are_no_command_are_refused(values: dict[str, Any], reason: str) -> None:
    for deployed in ((), (program(),)):
        eve = Stage(*deployed).connect("eve/1", 50)
        assert reason in eve.problem(actuator.command("move", values)).message


def test_other_commands_are_refused() -> None:
    eve = Stage().connect("eve/1", 50)
    assert eve.problem(actuator.command("mvoe", {})).message == "Lift has no command `mvoe`; it has move"


def test_a_field_that_the_actuator_does_not_declare_may_be_left_out() -> None:
    alone = structs.replace(LIFT, fields=(HEIGHT,), field_indices=(0, None), idle=(5.0,), reported=())
    stage = Stage(program("run", alone))
    eve = stage.connect("eve/1", 50)
    assert "the actuator `lift` has no such field" in eve.problem(to(100.0)).message
    eve.do(actuator.command("move", {"height": 100.0}))
    [verdict] = verdicts(stage.decide(1))
    assert stage.take() == [(100.0, False)]
    assert verdict.values == (100.0,)


# --- stops -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("deployed", [(), (program(),), (program("run", HOLDING),)])
@pytest.mark.parametrize("by_tick", [False, True])
def test_an_emergency_stop_beats_all(deployed: tuple[Any, ...], by_tick: bool) -> None:
    stage, run = Stage(*deployed), "run" if deployed else ""
    eve = stage.connect("eve/1", 50)
    eve.do(actuator.lock())
    eve.do(to(100.0))
    stage.tick(1, run=run)
    assert stage.take() == [(100.0, True)]
    if by_tick:
        stage.tick(2, run=run, stopped=Stopped(by="bob/1", t_ns=stage.now_ns))
    else:
        stage.handle(call_of(emergency.stop(), "bob/1"))
    stopped = (0.0, False) if deployed and deployed[0].actuators[0].idle else "safe"
    assert set(stage.take()) == {stopped}
    assert eve.refusal(to(100.0)) == "stopped"
    stage.tick(3, run=run)
    assert set(stage.take()) <= {stopped}
    stage.tick(4, run=run, released_ns=stage.now_ns)
    stage.bid(4)
    stage.bid(4, client="down")
    assert (100.0, True) not in stage.take(), "the command is over"
    eve.do(to(100.0))
    stage.tick(5, run=run)
    assert stage.take()[-1] == (100.0, True)


def test_a_silent_clock_stops_it_and_refuses_commands() -> None:
    stage = Stage()
    eve = stage.connect("eve/1", 50)
    eve.do(to(100.0, lease=60.0))
    stage.tick(1, run="")
    stage.take()
    stage.pass_time(3 * FRAME_NS)
    assert stage.take() == ["safe"]
    eve = stage.connect("eva/1", 51)
    stage.now_ns += CLOCK_GRACE_NS
    assert eve.refusal(to(100.0)) in ("clock", "closed")
    assert stage.connect("ann/1", 52).refusal(to(100.0)) == "clock"


# --- what is known of it -----------------------------------------------------------------------------------


def test_the_arbitration_shows_who_commands() -> None:
    stage = Stage(program())
    eve, bob = stage.connect("eve/1", 50), stage.connect("bob/1", 60)
    eve.do(to(100.0, lease=1.0))
    bob.do(actuator.ignore_limits())
    stage.decide(1, 300.0, True)
    found = bob.do(actuator.arbitration())
    assert (found.run, found.leader, found.lock_holder, found.stopped) == ("run", "ada/1", None, None)
    [lift] = found.actuators
    assert (lift.name, lift.command, lift.acting, lift.frames) == ("lift", "move", "eve/1", 1)
    assert [(o.name, o.values, o.lease_s, o.unlimited) for o in found.outside] == [
        ("bob", None, None, True),
        ("eve", {"height": 100.0, "fast": True}, 0.95, False),
    ]


def test_methods_that_all_servers_with_commands_have_cannot_be_declared() -> None:
    lock = method("lock", NoArguments, lambda caller, nothing: None)
    Service("Lift", (lock,), FieldReader("Lift", (), print), print)
    with pytest.raises(ValueError, match="Lift: found the methods `lock`, which servers with commands have"):
        Service(
            "Lift",
            (lock,),
            FieldReader("Lift", [field("x", lambda: 1.0)], print),
            print,
            commands=[Lift().command()],
        )
