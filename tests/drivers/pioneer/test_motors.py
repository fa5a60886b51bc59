"""The emulated robot moves by the commands that other programs send: distances, headings, single wheels."""

from __future__ import annotations

import struct

import pytest

from colony.drivers.pioneer.codec import CommandNumber, command, decoder
from tests.drivers.pioneer.test_firmware import P3DX, opened, packets, wait


def test_a_move_ends_after_its_distance() -> None:
    robot = opened()
    robot.receive(command(CommandNumber.SETV, 200) + command(CommandNumber.MOVE, -600))
    wait(robot, 2.0, command(CommandNumber.PULSE))
    assert robot.speed == -200.0
    wait(robot, 3.0, command(CommandNumber.PULSE))
    assert (robot.pose[0], robot.speed) == (pytest.approx(-600.0, abs=1.0), pytest.approx(0.0, abs=1.0))


@pytest.mark.parametrize(
    ("turn", "expected"),
    [(command(CommandNumber.HEAD, 270), -90.0), (command(CommandNumber.DHEAD, 60), 90.0), (b"", 30.0)],
)
def test_it_turns_to_a_heading_and_holds_it(turn: bytes, expected: float) -> None:
    robot = opened()
    robot.receive(command(CommandNumber.SETRV, 40) + command(CommandNumber.DHEAD, 30))
    wait(robot, 3.0, command(CommandNumber.PULSE))
    robot.receive(turn)
    assert max(abs(sip.turn_rate or 0) for sip in wait(robot, 6.0, command(CommandNumber.PULSE))) <= 400
    assert robot.pose[2] == pytest.approx(expected, abs=0.5)


def test_both_wheels_are_driven_in_units_of_20_mm_per_second() -> None:
    robot = opened()
    robot.receive(command(CommandNumber.VEL2, 0x0AF6))  # left 200 mm/s, right -200
    (*_, last) = wait(robot, 2.0)
    assert (last.left_speed, last.right_speed) == (200, -200)
    robot.receive(command(CommandNumber.VEL, 100))  # the rotation holds
    (*_, last) = wait(robot, 1.0)
    assert (last.left_speed, last.right_speed) == (300, -100)


def test_rotate_is_another_name_of_a_turning_speed() -> None:
    robot = opened()
    robot.receive(command(CommandNumber.ROTATE, -30))
    wait(robot, 1.0)
    assert robot.turn == -30.0


def test_an_emergency_stop_ends_a_move() -> None:
    robot = opened()
    robot.receive(command(CommandNumber.MOVE, 5000))
    wait(robot, 1.0)
    robot.receive(command(CommandNumber.ESTOP) + command(CommandNumber.VEL, 0))
    wait(robot, 1.0)
    assert (robot.speed, robot.set_points) == (0.0, (0.0, 0.0))
    robot.receive(command(CommandNumber.MOVE, 100))
    wait(robot, 1.0)
    assert robot.speed > 0.0


def test_its_configuration_has_what_was_set() -> None:
    robot = opened()
    robot.receive(
        command(CommandNumber.SETV, 500)
        + command(CommandNumber.SETRA, -70)
        + command(CommandNumber.CONFIG, 1)
    )
    (data,) = decoder().feed(b"".join(robot.sent()))
    turn, speed, turn_acceleration, turn_deceleration = struct.unpack("<HHHH", data[-30:-22])
    assert (turn, speed, turn_acceleration, turn_deceleration) == (100, 500, 100, 70)
    assert struct.unpack("<HH", data[-16:-12]) == (300, 300)


def test_sonars_fire_from_the_beginning_of_a_session() -> None:
    robot = opened()
    numbers = {number for sip in wait(robot, 0.8) for number, _ in sip.sonars}
    assert len(numbers) == len(P3DX.sonars)
    robot.receive(command(CommandNumber.SONAR, 0))
    assert not any(sip.sonars for sip in wait(robot, 1.0)[1:])
    assert packets(robot) == []
