"""A program that drives a lift of its own server, in virtual time; `tools.loss` has faults of all kinds."""

from __future__ import annotations

from tests.kit.lift import DOWN, IDLE, UP, Robot


def test_a_program_drives_a_lift() -> None:
    robot = Robot()
    robot.run(12)
    assert [robot.told[k] for k in range(1, 10)] == [*[UP] * 5, DOWN, UP, DOWN, UP]
    assert [frame.verdicts["lift"].values for frame in robot.log.frames[1:10]] == [
        robot.told[k] for k in range(1, 10)
    ]
    assert not any(frame.disagreements for frame in robot.log.frames)
    assert robot.reports == []


def test_a_lift_whose_client_dies_is_idle() -> None:
    robot = Robot()
    [clients] = set(robot.robot.processes) - {"Clock", "DServer", "Lift"}
    robot.at(3, lambda: robot.robot.kill(clients))
    robot.run(12)
    assert [robot.told[k] for k in range(1, 4)] == [UP] * 3
    assert [robot.told[k] for k in range(4, 12)] == [IDLE] * 8
    assert not any(frame.disagreements for frame in robot.log.frames)


def test_a_lift_that_comes_back_is_driven_again_once_the_program_is_deployed() -> None:
    robot = Robot()
    robot.at(3, lambda: robot.robot.restart("Lift"))
    robot.at(6, robot.deploy)
    robot.run(30)
    assert [k for k in range(4, 7) if k in robot.told] == []
    assert {robot.told[k] for k in range(8, 12)} <= {UP, DOWN, IDLE}
    assert {robot.told[k] for k in range(20, 30)} <= {UP, DOWN}
    assert not any(frame.disagreements for frame in robot.log.frames)


def test_a_clock_that_dies_leaves_the_lift_idle() -> None:
    robot = Robot()
    robot.at(3, lambda: robot.robot.kill("Clock"))
    robot.run(12)
    assert max(robot.told) == 5
    assert robot.told[5] == IDLE
