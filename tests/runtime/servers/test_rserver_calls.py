"""The calls of Table 4.1: what they do to the base, what they answer, and what they refuse."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from colony.runtime.library import emergency, robot
from colony.runtime.library.ask import CallRequest
from colony.runtime.servers.drivers import BaseState
from tests.kit.base import RollingBase, Stage, deployed, silent
from tests.kit.node_stage import result_of


def stage_for(connection: str = "ann/1", priority: int = 0, **options: Any) -> Stage:
    stage = Stage(**options)
    stage.open(connection, priority)
    return stage


@pytest.fixture
def stage() -> Stage:
    return stage_for()


def done(stage: Stage, ask: CallRequest[Any], connection: str = "ann/1") -> Any:
    number = stage.send(connection, ask)
    stage.frames_until(connection, number)
    return result_of(ask, stage.replies[connection, number])


def test_go_goes_straight_on_for_its_lease_and_longer_where_it_is_told_again(stage: Stage) -> None:
    stage.do("ann/1", robot.go(200.0))
    stage.frame(count=5)
    stage.do("ann/1", robot.go(200.0, lease=0.3))
    stage.frame(count=6)
    assert stage.base.velocity == 200.0
    assert stage.do("ann/1", robot.mode()) == "go"
    stage.frame(count=2)
    assert stage.base.velocity == 0.0
    assert stage.base.y > 60.0
    assert (stage.base.x, stage.base.heading) == (0.0, 0.0)


def test_go_told_again_goes_on_holding_the_same_heading(stage: Stage) -> None:
    stage.base.pushed = 2.0
    for _ in range(200):
        stage.do("ann/1", robot.go(200.0, lease=0.2))
        stage.frame()
    assert abs(math.remainder(stage.base.heading, 360.0)) < 0.1
    stage.do("ann/1", robot.proportional_go(200.0))
    assert stage.do("ann/1", robot.mode()) == "go"
    stage.frame()
    assert stage.do("ann/1", robot.mode()) == "proportional go"


def test_jog_turns_clockwise_on_top_of_what_this_connection_does(stage: Stage) -> None:
    stage.do("ann/1", robot.go(100.0))
    stage.frame(count=8)
    stage.do("ann/1", robot.jog(20.0))
    stage.frame(count=8)
    assert stage.base.told[-1][1:] == (100.0, -20.0)
    assert stage.base.heading > 270.0
    assert stage.do("ann/1", robot.mode()) == "jog"
    stage.frame(count=10)
    stage.do("ann/1", robot.jog(-20.0))
    stage.frame(count=8)
    assert stage.base.told[-1][1:] == (0.0, 20.0)


def test_drive_sends_exactly_what_it_says_counterclockwise(stage: Stage) -> None:
    stage.do("ann/1", robot.drive(123.0, 45.0))
    stage.frame()
    assert stage.base.told[-1][1:] == (123.0, 45.0)
    assert stage.do("ann/1", robot.speed_setting()) == 123.0
    assert stage.do("ann/1", robot.wheel_speed()) == 123.0


def test_a_move_is_answered_when_it_is_done_and_then_stands(stage: Stage) -> None:
    assert done(stage, robot.move(700.0, 300.0, 400.0)) == pytest.approx(700.0, abs=1.5)
    assert stage.base.y == pytest.approx(700.0, abs=1.5)
    stage.frame(count=5)
    assert stage.base.velocity == 0.0
    assert stage.do("ann/1", robot.mode()) == "go"
    assert done(stage, robot.move(-200.0)) == pytest.approx(200.0, abs=1.5)
    assert stage.base.y == pytest.approx(500.0, abs=3.0)


def test_a_turn_is_clockwise_and_an_arc_too(stage: Stage) -> None:
    done(stage, robot.turn(90.0))
    assert stage.base.heading == pytest.approx(270.0, abs=0.3)
    done(stage, robot.continuous_turn(-90.0, 400.0))
    assert math.remainder(stage.base.heading, 360.0) == pytest.approx(0.0, abs=0.5)
    assert (stage.base.x, stage.base.y) == pytest.approx((400.0, 400.0), abs=6.0)


def test_negative_velocities_and_accelerations_keep_the_present_settings(stage: Stage) -> None:
    done(stage, robot.move(300.0, 120.0, 600.0))
    stage.base.told.clear()
    done(stage, robot.move(300.0))
    assert max(v for _, v, _ in stage.base.told) == 120.0
    assert stage.base.told[0][1] == pytest.approx(600.0 * 0.05)
    done(stage, robot.turn(30.0, 15.0, 100.0))
    stage.base.told.clear()
    done(stage, robot.turn(30.0, -1.0, -2.0))
    assert min(w for _, _, w in stage.base.told) == -15.0


def test_without_waiting_a_motion_is_answered_at_once(stage: Stage) -> None:
    assert stage.do("ann/1", robot.move(100.0, 200.0, wait=False)) is None
    stage.frame()
    assert stage.do("ann/1", robot.mode()) == "point-to-point go"
    stage.frame(count=60)
    assert stage.base.y == pytest.approx(100.0, abs=1.5)


def problem_of(stage: Stage, number: int) -> str:
    found = stage.frames_until("ann/1", number).problem
    return found.code


def test_a_motion_that_ends_early_says_why(stage: Stage) -> None:
    first = stage.send("ann/1", robot.move(1000.0))
    stage.frame(count=3)
    second = stage.send("ann/1", robot.move(1000.0))
    assert problem_of(stage, first) == "replaced"
    stage.frame(count=10)
    stage.base.front = True
    stage.frame()
    assert problem_of(stage, second) == "bumper"
    assert stage.base.velocity == 0.0
    stage.base.front = False
    third = stage.send("ann/1", robot.turn(90.0))
    stage.base.held = True
    assert problem_of(stage, third) == "stalled"
    stage.base.held = False
    locked = stage.send("ann/1", robot.move(100.0))
    stage.do(stage.open("bob/1", priority=9), robot.lock())
    assert problem_of(stage, locked) == "locked"
    stage.close("bob/1")
    fourth = stage.send("ann/1", robot.turn(90.0))
    stage.frame()
    stage.do("ann/1", emergency.stop())
    assert problem_of(stage, fourth) == "stopped"


def test_a_turn_on_the_spot_does_not_mind_a_bumper(stage: Stage) -> None:
    stage.do("ann/1", robot.drive(300.0, 0.0))
    stage.frame(count=2)
    stage.base.front = True
    assert done(stage, robot.turn(90.0)) == pytest.approx(90.0, abs=0.3)
    assert all(velocity == 0.0 for _, velocity, _ in stage.base.told[2:])


def test_stopping_gradually_and_at_once() -> None:
    for mode, following in ((0, 300.0 - 400.0 * 0.05), (1, 0.0)):
        stage = stage_for()
        stage.do("ann/1", robot.drive(300.0, 0.0))
        stage.frame(count=2)
        stage.do("ann/1", robot.stop(mode))
        stage.frame()
        assert stage.base.velocity == pytest.approx(following)
        assert len(stage.base.stops) == 1 + mode  # it stops at its start; at once is the stop of the device
        stage.frame(count=20)
        assert stage.base.velocity == 0.0


def test_a_base_that_reports_nothing_is_not_moved(stage: Stage) -> None:
    stage.base.mute = True
    for ask in (robot.drive(100.0, 0.0), robot.move(100.0), robot.set_bumper(0)):
        problem = stage.problem("ann/1", ask)
        assert (problem.code, problem.message) == ("no value", "RServer: the base does not report its state")
    stage.do("ann/1", robot.stop())
    stage.frame()
    assert all(velocity == 0.0 for _, velocity, _ in stage.base.told)
    stage.base.mute = False
    stage.do("ann/1", robot.drive(100.0, 0.0))


class Switched(RollingBase):
    """It stops by itself at a bumper, which can be switched off."""

    def __init__(self) -> None:
        super().__init__()
        self.watched: list[bool] = []

    def watch_bumpers(self, watched: bool) -> None:
        self.watched.append(watched)


def test_a_device_that_watches_its_bumpers_is_told_not_to() -> None:
    stage = stage_for(base=Switched())
    stage.do("ann/1", robot.set_bumper(0))
    stage.do("ann/1", robot.set_bumper(1))
    assert stage.base.watched == [False, True]


def test_a_stop_stands_in_the_networks_place_for_its_lease() -> None:
    stage = stage_for(priority=9, run="r1", deployment=deployed())
    stage.do("ann/1", robot.stop(1, lease=0.2))
    stage.frame(*silent(), count=5)
    assert [v.outside for v in stage.verdicts] == ["ann/1"] * 4 + [None]


def test_positions_are_reported_as_they_are_set(stage: Stage) -> None:
    stage.do("ann/1", robot.set_position(1000.0, 2000.0, 90.0))
    done(stage, robot.move(100.0))
    where = stage.do("ann/1", robot.position())
    assert (where.x, where.y, where.heading) == pytest.approx((900.0, 2000.0, 90.0), abs=1.5)
    assert where.t_ns == stage.now_ns
    stage.do("ann/1", robot.adjust_position(-900.0, 5.0, -100.0))
    where = stage.do("ann/1", robot.position())
    assert (where.x, where.y, where.heading) == pytest.approx((0.0, 2005.0, 350.0), abs=1.5)
    stage.tick()
    fields = stage.frames[-1].fields
    assert [fields[n].value for n in ("x", "y", "heading")] == pytest.approx(  # type: ignore[union-attr]
        [where.x, where.y, where.heading]
    )


def test_a_position_set_during_a_motion_does_not_disturb_it(stage: Stage) -> None:
    number = stage.send("ann/1", robot.move(500.0))
    stage.frame(count=10)
    stage.do("ann/1", robot.set_position(-30000.0, 7.0, 123.0))
    stage.frames_until("ann/1", number)
    assert stage.base.y == pytest.approx(500.0, abs=1.5)


class Narrow(RollingBase):
    """Its registers have 16 bits."""

    register_bits = 16

    def state(self) -> BaseState | None:
        state = super().state()
        x, y = ((round(v) + 32768) % 65536 - 32768 for v in (state.x, state.y))
        return replace(state, x=float(x), y=float(y))


def test_positions_go_on_beyond_16_bits_without_anybody_asking() -> None:
    stage = stage_for(base=Narrow())
    stage.frame()
    for _ in range(5):  # nobody asks, RServer looks by itself
        stage.base.y += 32_000.0
        stage.frame()
    stage.base.x -= 20_000.0
    stage.frame()
    stage.base.x -= 20_000.0
    where = stage.do("ann/1", robot.position())
    assert (where.x, where.y) == (-40_000.0, 160_000.0)


def test_bumpers_are_told_by_code(stage: Stage) -> None:
    for front, rear, code in ((False, False, 0), (True, False, 1), (False, True, 2), (True, True, 3)):
        stage.base.front, stage.base.rear = front, rear
        assert stage.do("ann/1", robot.bumper()).code == code


def test_the_first_mode_is_the_joysticks_and_again_after_an_emergency_stop(stage: Stage) -> None:
    assert stage.do("ann/1", robot.mode()) == "joystick"
    stage.do("ann/1", robot.go(100.0))
    stage.frame()
    assert stage.do("ann/1", robot.mode()) == "go"
    stage.do("ann/1", emergency.stop())
    assert stage.do("ann/1", robot.mode()) == "joystick"


WRONG = [
    (robot.drive(601.0, 0.0), "velocity is 601 mm/s; expected -600 to 600 mm/s"),
    (robot.drive(math.nan, 0.0), "velocity is nan"),
    (robot.drive(0.0, math.inf), "turn is inf"),
    (robot.drive(0.0, -91.0), "turn is -91"),
    (robot.go(-601.0), "velocity is -601"),
    (robot.jog(91.0), "rate is 91"),
    (robot.move(math.inf), "distance is inf"),
    (robot.move(100.0, 0.0), "velocity is 0"),
    (robot.move(100.0, 601.0), "velocity is 601"),
    (robot.move(100.0, math.nan), "velocity is nan"),
    (robot.move(100.0, 100.0, 801.0), "acceleration is 801"),
    (robot.turn(math.nan), "degrees is nan"),
    (robot.turn(90.0, 100.0), "velocity is 100"),
    (robot.continuous_turn(90.0, 0.0), "radius is 0"),
    (robot.continuous_turn(90.0, -5.0), "radius is -5"),
    (robot.set_position(0.0, math.nan, 0.0), "finite"),
    *((robot.drive(0.0, 0.0, lease), "a lease of") for lease in (0.0, -1.0, math.inf, math.nan, 61.0)),
]


@pytest.mark.parametrize(("ask", "text"), WRONG, ids=[text for _, text in WRONG])
def test_what_cannot_be_is_refused_with_what_was_expected(
    stage: Stage, ask: CallRequest[Any], text: str
) -> None:
    problem = stage.problem("ann/1", ask)
    assert problem.code == "arguments"
    assert text in problem.message
    stage.frame()
    assert stage.base.told == [(0, 0.0, 0.0)]
    assert stage.do("ann/1", robot.arbitration()).outside == ()


def test_the_programs_range_is_that_of_everyone() -> None:
    stage = stage_for(priority=9, run="r1", deployment=deployed())
    assert "expected -300 to 500" in stage.problem("ann/1", robot.drive(-301.0, 0.0)).message
    assert "expected -60 to 60" in stage.problem("ann/1", robot.jog(61.0)).message
    assert "expected 0 to 300" in stage.problem("ann/1", robot.move(-100.0, 400.0)).message


def test_a_standing_command_is_clamped_by_a_program_that_comes_later() -> None:
    stage = stage_for(priority=9)
    stage.open("lead/1", priority=100)
    stage.do("ann/1", robot.drive(600.0, 90.0, lease=5.0))
    stage.frame()
    stage.do("lead/1", robot.deploy(deployed()))
    stage.run = "r1"
    stage.frame(*silent())
    assert stage.base.told[-1][1:] == (500.0, 60.0)


MOVING: list[CallRequest[Any]] = [
    robot.drive(10.0, 0.0),
    robot.go(10.0),
    robot.proportional_go(10.0),
    robot.jog(10.0),
    robot.stop(1),
    robot.move(100.0),
    robot.turn(10.0),
    robot.continuous_turn(90.0, 200.0),
]


@pytest.mark.parametrize("ask", MOVING, ids=lambda ask: ask.method)
def test_arbitration_names_the_call_by_which_a_connection_commands(
    stage: Stage, ask: CallRequest[Any]
) -> None:
    stage.send("ann/1", ask)
    stage.frame()
    [report] = stage.do("ann/1", robot.arbitration()).outside
    assert report.commands == ask.method
