"""Commands of servers written with the kit: who decides, what stops them, and what fails."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from msgspec import structs

from colony.runtime.library import emergency
from colony.runtime.library.clock import deploy
from colony.runtime.protocol import topics
from colony.runtime.protocol.deployment import ActuatorSpec
from colony.runtime.protocol.messages import Effect, Reply, SendMessage, Stopped
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
from tests.kit.node_stage import FRAME_NS, MS, messages

# --- frames ----------------------------------------------------------------------------------------------


def test_the_command_of_a_frame_is_performed_once() -> None:
    stage = Stage(program())
    effects = stage.decide(1, 300.0, True)
    assert stage.take() == [(300.0, True)]
    [verdict] = verdicts(effects)
    assert (verdict.by, verdict.values, verdict.notes) == ("up", (300.0, True), ())
    stage.bid(1, 100.0, True, client="down")
    assert stage.take() == []


def test_where_nobody_commands_it_is_idle_in_each_frame_and_holds_if_that_is_declared() -> None:
    idle, holding = Stage(program()), Stage(program("run", HOLDING))
    for stage in (idle, holding):
        stage.decide(1, 300.0, True)
        stage.decide(2)
        stage.decide(3)
    assert idle.take() == [(300.0, True), (0.0, False), (0.0, False)]
    assert holding.take() == [(300.0, True)]


def test_the_next_frame_has_what_was_given_last() -> None:
    stage = Stage(program())

    def last(effects: list[Effect]) -> list[object]:
        [frame] = frames(effects)
        samples = [frame.fields.get(name) for name in ("last.lift.height", "last.lift.fast", "height")]
        return [sample and sample.value for sample in samples]

    assert last(stage.decide(1, 300.0, True)) == [None, None, 7.0]
    assert last(stage.decide(2)) == [300.0, True, 7.0]
    assert last(stage.decide(3)) == [0.0, False, 7.0]
    answers = [e.message for e in stage.effects if isinstance(e, SendMessage) and e.topic == topics.ANSWERS]
    assert [(frame.k, dict(frame.fields)) for frame in answers] == [(1, {}), (2, {}), (3, {})]  # type: ignore[union-attr]


def test_a_field_that_the_actuator_does_not_declare_is_zero() -> None:
    alone = structs.replace(LIFT, fields=(HEIGHT,), field_indices=(0, None), idle=(5.0,), reported=())
    stage = Stage(program("run", alone))
    stage.decide(1, 300.0)
    stage.decide(2)
    assert stage.take() == [(300.0, False), (5.0, False)]


# --- stops -----------------------------------------------------------------------------------------------

STOP = call_of(emergency.stop(), "eve/1")


def stop_by_call(stage: Stage) -> None:
    [reply] = messages(stage.handle(STOP), Reply)
    assert reply.problem is None


def stop_by_tick(stage: Stage) -> None:
    stage.tick(2, stopped=Stopped(by="eve/1", t_ns=stage.now_ns))


def silence(stage: Stage) -> None:
    stage.pass_time(3 * FRAME_NS)


def end(stage: Stage) -> None:
    stage.node.close()


STOPS = [stop_by_call, stop_by_tick, silence, end]


@pytest.mark.parametrize("stopping", STOPS)
def test_whatever_stops_it_makes_the_actuator_idle_or_safe(stopping: Callable[[Stage], None]) -> None:
    for actuator, stopped in ((LIFT, (0.0, False)), (HOLDING, "safe")):
        stage = Stage(program("run", actuator))
        stage.decide(1, 300.0, True)
        stage.take()
        stopping(stage)
        assert set(stage.take()) == {stopped}


@pytest.mark.parametrize("stopping", STOPS)
def test_without_a_program_the_device_is_made_safe(stopping: Callable[[Stage], None]) -> None:
    stage = Stage()
    stage.tick(1, run="")
    assert stage.take() == []
    stopping(stage)
    assert stage.take() == ["safe"]


def test_a_stop_in_the_middle_of_a_frame_ends_it() -> None:
    stage = Stage(program())
    stage.tick(1)
    stop_by_call(stage)
    assert set(stage.take()) == {(0.0, False)}
    stage.bid(1, 300.0, True)
    assert stage.take() == []


def test_a_silent_clock_stops_it_once_and_a_tick_goes_on() -> None:
    stage = Stage(program())
    stage.decide(1, 300.0, True)
    stage.take()
    stage.pass_time(2 * FRAME_NS)
    assert stage.take() == []
    stage.pass_time(20 * FRAME_NS)
    assert stage.take() == [(0.0, False)]
    stage.decide(2, 200.0, True)
    assert stage.take() == [(200.0, True)]


def test_a_tick_that_comes_too_late_moves_nothing() -> None:
    for actuator, instead in ((LIFT, (0.0, False)), (HOLDING, "safe")):
        stage = Stage(program("run", actuator))
        stage.tick(1)
        stage.now_ns += 101 * MS
        stage.bid(1, 300.0, True)
        assert set(stage.take()) == {instead}
        [verdict] = verdicts(stage.bid(1, client="down"))
        assert verdict.notes == ("frame 1: no command was sent, as the tick came too late",)


def test_a_verdict_that_is_made_with_its_command_says_that_it_was_not_sent() -> None:
    stage = Stage(program())
    stage.tick(1)
    stage.bid(1, client="down")
    stage.now_ns += 101 * MS
    [verdict] = verdicts(stage.bid(1, 300.0, True))
    assert verdict.notes == ("frame 1: no command was sent, as the tick came too late",)
    [verdict] = verdicts(stage.decide(2, 300.0, True))
    assert verdict.notes == ()


# --- runs ------------------------------------------------------------------------------------------------


def test_it_is_idle_when_its_run_ends_and_holds_if_that_is_declared() -> None:
    for actuator, at_the_end in ((LIFT, [(0.0, False)]), (HOLDING, [])):
        stage = Stage(program("run", actuator))
        stage.decide(1, 300.0, True)
        stage.take()
        stage.tick(2, run="")
        stage.tick(3, run="")
        assert stage.take() == at_the_end


@pytest.mark.parametrize("stopping", [silence, end])
def test_what_is_idle_of_a_program_counts_after_its_end(stopping: Callable[[Stage], None]) -> None:
    for actuator, stopped in ((LIFT, (0.0, False)), (HOLDING, "safe")):
        stage = Stage(program("run", actuator))
        stage.decide(1, 300.0, True)
        stage.leader.close()
        stage.tick(2, run="")
        stage.take()
        stopping(stage)
        assert set(stage.take()) == {stopped}


def test_two_runs_after_each_other() -> None:
    other = structs.replace(LIFT, name="arm", clients=(("reach", 1),))
    stage = Stage(program())
    stage.decide(1, 300.0, True)
    stage.leader.do(deploy(program("next", other)))
    assert stage.take() == [(300.0, True), (0.0, False)]
    stage.tick(2, run="next")
    stage.bid(2, 300.0, True)
    assert stage.take() == [], "which is a request of the run before"
    stage.bid(2, 100.0, True, actuator="arm", client="reach")
    assert stage.take() == [(100.0, True)]
    stage.leader.do(deploy(program("next", other)))
    stage.tick(3, run="next")
    stage.bid(3, 120.0, True, actuator="arm", client="reach")
    assert stage.take() == [(120.0, True)]


WRONG = [
    (structs.replace(LIFT, field_indices=(0, 7)), "`fast` is not one of its 2 fields"),
    (structs.replace(LIFT, field_indices=(1, 0)), "`height` is a bool"),
    (structs.replace(LIFT, idle=(500.0, False)), "height = 500.0 when idle; expected 0 to 400"),
    (structs.replace(LIFT, idle=(0.0, 1.0)), "fast = 1.0 when idle; expected a bool"),
]


@pytest.mark.parametrize(("actuator", "reason"), WRONG)
def test_a_program_that_does_not_fit_is_refused(actuator: ActuatorSpec, reason: str) -> None:
    stage = Stage()
    stage.leader.open("leader")
    problem = stage.leader.problem(deploy(program("run", actuator)))
    assert problem.code == "deployment"
    assert reason in problem.message


# --- failures of the device ------------------------------------------------------------------------------


def test_a_command_that_fails_is_not_sent_and_the_server_goes_on() -> None:
    stage = Stage(program())
    stage.decide(1, 300.0, True)
    stage.lift.failure = OSError("cable")
    [verdict] = verdicts(stage.decide(2, 310.0, True))
    assert stage.take() == [(300.0, True), "safe"], "as the idle command fails, too"
    effects = stage.decide(3, 320.0, True)
    assert verdict.notes == ("frame 2: Lift.move failed: OSError: 'cable'",)
    [frame] = frames(effects)
    assert frame.fields["last.lift.height"].value == 300.0  # type: ignore[union-attr]
    stage.lift.failure = None
    stage.decide(4, 330.0, True)
    assert stage.take() == ["safe", (330.0, True)]
    assert stage.reports == ["Lift.move failed: OSError: cable"]


def test_where_only_a_command_fails_the_actuator_is_idle_for_that_frame() -> None:
    class Picky(Lift):
        def move(self, height: float, fast: bool) -> None:
            if height > 200.0:
                raise ValueError("too high")
            super().move(height, fast)

    stage = Stage(program(), lift=Picky())
    stage.decide(1, 100.0, True)
    stage.decide(2, 300.0, True)
    assert stage.take() == [(100.0, True), (0.0, False)]
    [frame] = frames(stage.tick(3))
    assert frame.fields["last.lift.height"].value == 0.0  # type: ignore[union-attr]
    [report] = stage.reports
    assert report.startswith("Lift.move failed:\nTraceback")
    assert report.endswith("ValueError: too high")


def test_a_command_out_of_the_range_of_the_device_is_not_sent() -> None:
    wide = structs.replace(LIFT, fields=(structs.replace(HEIGHT, high=1000.0), FAST))
    stage = Stage(program("run", wide))
    stage.decide(1, 500.0, True)
    [verdict] = verdicts(stage.decide(2, 600.0, True))
    assert stage.take() == [(0.0, False), (0.0, False)]
    assert verdict.notes == ("frame 2: Lift.move was not sent height = 600: expected 0 to 400",)
    assert stage.reports == ["Lift.move was not sent height = 500: expected 0 to 400"]


def test_a_safe_that_fails_ends_nothing() -> None:
    class Broken(Lift):
        def safe(self) -> None:
            super().safe()
            raise OSError("cable")

    stage = Stage(program("run", HOLDING), lift=Broken())
    assert messages(stage.handle(STOP), Reply) == []
    assert stage.take() == ["safe"]
    [reply] = messages(stage.pass_time(150 * MS), Reply)
    assert reply.problem.code == "not reached"
    assert reply.problem.message.endswith("its device: safe of Lift.move failed: OSError: cable")
    stage.take()
    stage.tick(1, released_ns=stage.now_ns)
    stage.bid(1, 300.0, True)
    assert stage.take() == ["safe", (300.0, True)]  # tried again, until a command is performed
    assert stage.reports == ["safe of Lift.move failed: OSError: cable"]
