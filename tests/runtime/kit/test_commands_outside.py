"""Connections that command an actuator of a server written with the kit, beside a program and without one."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from msgspec import structs

from colony.runtime.kit.description import FieldReader, field
from colony.runtime.kit.service import Service, method
from colony.runtime.library import actuator, emergency
from colony.runtime.library.ask import CallRequest
from colony.runtime.library.clock import deploy
from colony.runtime.protocol.calls import NoArguments
from colony.runtime.protocol.messages import Bounds, Effect, Stopped
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
from tests.kit.node_stage import MS, Caller

LIMITED = structs.replace(LIFT, limited=True)


def to(height: float, fast: bool = True, lease: float = 10.0) -> CallRequest[None]:
    return actuator.command("move", {"height": height, "fast": fast}, lease)


def bounds(k: int, low: float = 0.0, high: float = 250.0, **options: Any) -> Bounds:
    return Bounds(k=k, actuator="lift", low=(low, None), high=(high, None), **options)


# --- priorities ------------------------------------------------------------------------------------------


# --- leases ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("end", [Caller.close, lambda eve: eve.do(actuator.give_way())])
def test_where_the_program_holds_the_device_is_made_safe_when_a_command_of_a_connection_ends(
    end: Callable[[Caller], None],
) -> None:
    stage = Stage(program("run", HOLDING))
    stage.decide(1, 300.0, True)
    stage.decide(2)
    assert stage.take() == [(300.0, True)], "what the program commanded holds"
    eve = stage.connect("eve/1", 50)
    eve.do(to(100.0))
    stage.decide(3)
    end(eve)
    stage.decide(4)
    stage.decide(5)
    assert stage.take() == [(100.0, True), "safe"]


# --- locks -----------------------------------------------------------------------------------------------


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


def test_where_the_bounds_do_not_come_the_actuator_is_idle_or_safe() -> None:
    for spec, instead in ((LIMITED, (0.0, False)), (structs.replace(LIMITED, idle=None), "safe")):
        stage, _ = limited(spec)
        bounded(stage, 1, bounds(1))
        stage.decide(2)
        [verdict] = verdicts(stage.pass_time(40 * MS))
        assert stage.take() == [(250.0, True), instead]
        assert verdict.fault == "limits unknown"


def test_command_that_limits_held_ends_in_a_frame_of_another_run() -> None:
    stage, _ = limited()
    bounded(stage, 1, bounds(1))
    stage.tick(2, run="")
    bounded(stage, 3, bounds(3))
    assert set(stage.take()[1:]) == {(0.0, False)}


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


@pytest.mark.parametrize("by_tick", [False, True])
def test_emergency_stop_makes_the_device_safe_whose_program_holds(by_tick: bool) -> None:
    stage, run = Stage(program("run", HOLDING)), "run"
    eve = stage.connect("eve/1", 50)
    eve.do(actuator.lock())
    eve.do(to(100.0))
    stage.tick(1, run=run)
    assert stage.take() == [(100.0, True)]
    if by_tick:
        stage.tick(2, run=run, stopped=Stopped(by="bob/1", t_ns=stage.now_ns))
    else:
        stage.handle(call_of(emergency.stop(), "bob/1"))
    assert set(stage.take()) == {"safe"}
    stage.tick(3, run=run)
    assert set(stage.take()) <= {"safe"}
    stage.tick(4, run=run, released_ns=stage.now_ns)
    stage.bid(4)
    stage.bid(4, client="down")
    assert (100.0, True) not in stage.take(), "the command is over"
    eve.do(to(100.0))
    stage.tick(5, run=run)
    assert stage.take()[-1] == (100.0, True)


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
