"""The Navigator's clerk."""

from __future__ import annotations

import pytest

from colony.nav.missions.clerk import TRACKER_TIMEOUT_S, clerk
from colony.nav.shared import (
    CEILING_LIGHT,
    GOAL_ANSWERED,
    GOAL_DATA,
    GOAL_DISTANCE,
    GOAL_NUMBER,
    GOAL_REACHED,
    GOAL_TYPE,
    ROBOT_STATUS,
    GoalKind,
)
from colony.runtime.library import data
from tests.kit.script_stage import RobotStage


def waiting() -> RobotStage:
    stage = RobotStage(clerk=clerk())
    stage.run(0.1)
    assert stage.semaphore(GOAL_DATA) == stage.semaphore(ROBOT_STATUS) == 0
    assert stage.told(GOAL_NUMBER) is None
    return stage


def test_goals_are_numbered_and_answered_when_they_are_reached() -> None:
    stage = waiting()
    for number in (1, 2, 3):
        stage.signal(GOAL_DATA)
        stage.run(1.0)
        assert stage.variable(GOAL_NUMBER) == number
        assert stage.semaphore(ROBOT_STATUS) == number - 1
        stage.tell(GOAL_REACHED, number)
        stage.run(0.2)
        assert stage.semaphore(ROBOT_STATUS) == number


def test_an_answer_to_an_earlier_goal_is_none() -> None:
    stage = waiting()
    stage.tell(GOAL_REACHED, 7)
    stage.signal(GOAL_DATA)
    stage.run(1.0)
    assert stage.semaphore(ROBOT_STATUS) == 0


def test_it_looks_once_a_frame() -> None:
    stage = waiting()
    stage.signal(GOAL_DATA)
    stage.run(0.1)
    before = stage.now_ns
    stage.tell(GOAL_REACHED, 1)
    while not stage.semaphore(ROBOT_STATUS):
        stage.run(0.05)
    assert stage.now_ns - before <= 100_000_000


def test_a_goal_in_place_of_another_takes_its_turn_at_once() -> None:
    stage = waiting()
    stage.signal(GOAL_DATA)
    stage.run(1.0)
    stage.signal(GOAL_DATA)
    stage.run(0.1)
    assert stage.variable(GOAL_NUMBER) == 2
    stage.tell(GOAL_REACHED, 1)
    stage.run(1.0)
    assert stage.semaphore(ROBOT_STATUS) == 0
    stage.tell(GOAL_REACHED, 2)
    stage.run(0.2)
    assert stage.semaphore(ROBOT_STATUS) == 1


def test_a_clerk_that_starts_again_goes_on_counting() -> None:
    stage = RobotStage(clerk=clerk())
    stage.ask(data.set_many({GOAL_NUMBER: 41, GOAL_REACHED: 41, GOAL_ANSWERED: 41}))
    stage.run(0.1)
    stage.signal(GOAL_DATA)
    stage.run(1.0)
    assert stage.variable(GOAL_NUMBER) == 42
    assert stage.semaphore(ROBOT_STATUS) == 0


@pytest.mark.parametrize("meanwhile", [False, True])
def test_a_clerk_that_starts_again_answers_the_goal_that_is_pursued(meanwhile: bool) -> None:
    """Else the Planner would wait for ever. It is reached after the new one begins, or before that."""
    stage = waiting()
    stage.signal(GOAL_DATA)
    stage.run(1.0)
    stage.begin()
    if meanwhile:
        stage.tell(GOAL_REACHED, 1)
    stage.begin(clerk=clerk())
    stage.run(1.0)
    stage.tell(GOAL_REACHED, 1)
    stage.run(1.0)
    assert stage.variable(GOAL_NUMBER) == stage.variable(GOAL_ANSWERED) == 1
    assert stage.semaphore(ROBOT_STATUS) == 1
    stage.signal(GOAL_DATA)
    stage.run(1.0)
    assert stage.variable(GOAL_NUMBER) == 2
    assert stage.semaphore(ROBOT_STATUS) == 1


def test_a_clerk_that_starts_again_answers_nobody_for_a_goal_that_was_replaced() -> None:
    stage = waiting()
    stage.signal(GOAL_DATA)
    stage.run(1.0)
    stage.begin()
    stage.tell(GOAL_REACHED, 1)
    stage.signal(GOAL_DATA)  # another Planner's
    stage.begin(clerk=clerk())
    stage.run(1.0)
    assert stage.variable(GOAL_NUMBER) == 2
    assert stage.semaphore(ROBOT_STATUS) == 0


def test_lights_are_held_back_until_the_old_count_is_gone() -> None:
    stage = waiting()
    stage.ask(data.set_many({GOAL_TYPE: int(GoalKind.LIGHTS), GOAL_DISTANCE: 3, CEILING_LIGHT: 11}))
    stage.signal(GOAL_DATA)
    stage.run(0.5)
    assert stage.told(GOAL_NUMBER) is None
    stage.tell(CEILING_LIGHT, 0)
    stage.run(0.15)
    assert stage.variable(GOAL_NUMBER) == 1


def test_lights_are_not_held_back_for_ever() -> None:
    stage = waiting()
    stage.ask(data.set_many({GOAL_TYPE: int(GoalKind.LIGHTS), GOAL_DISTANCE: 1, CEILING_LIGHT: 1}))
    stage.signal(GOAL_DATA)
    stage.run(TRACKER_TIMEOUT_S + 0.2)
    assert stage.variable(GOAL_NUMBER) == 1


def test_other_goals_do_not_wait_for_lights() -> None:
    stage = waiting()
    stage.ask(data.set_many({GOAL_TYPE: int(GoalKind.ENTER_CORNER), GOAL_DISTANCE: 3, CEILING_LIGHT: 11}))
    stage.signal(GOAL_DATA)
    stage.run(0.1)
    assert stage.variable(GOAL_NUMBER) == 1
