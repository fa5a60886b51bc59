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


def pursued() -> RobotStage:
    """A clerk that has taken its first goal."""
    stage = waiting()
    stage.signal(GOAL_DATA)
    stage.run(1.0)
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
    stage = pursued()
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
    stage = pursued()
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
    stage = pursued()
    stage.begin()
    stage.tell(GOAL_REACHED, 1)
    stage.signal(GOAL_DATA)  # another Planner's
    stage.begin(clerk=clerk())
    stage.run(1.0)
    assert stage.variable(GOAL_NUMBER) == 2
    assert stage.semaphore(ROBOT_STATUS) == 0


@pytest.mark.parametrize(
    ("kind", "distance", "count", "seconds", "number"),
    [
        (GoalKind.LIGHTS, 3, 11, 0.5, None),
        (GoalKind.LIGHTS, 3, 0, 0.15, 1),
        (GoalKind.LIGHTS, 1, 1, TRACKER_TIMEOUT_S + 0.2, 1),  # not for ever
        (GoalKind.ENTER_CORNER, 3, 11, 0.1, 1),
    ],
)
def test_lights_alone_are_held_back_until_the_old_count_is_gone(
    kind: GoalKind, distance: int, count: int, seconds: float, number: int | None
) -> None:
    stage = waiting()
    stage.ask(data.set_many({GOAL_TYPE: int(kind), GOAL_DISTANCE: distance, CEILING_LIGHT: count}))
    stage.signal(GOAL_DATA)
    stage.run(seconds)
    assert stage.told(GOAL_NUMBER) == number
