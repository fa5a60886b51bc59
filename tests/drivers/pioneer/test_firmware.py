"""The emulated robot does what the manuals say of a real one."""

from __future__ import annotations

import math

import pytest

from colony.drivers.emulator import STEP_S, room
from colony.drivers.pioneer.codec import CommandNumber, command, decoder
from colony.drivers.pioneer.firmware import PioneerFirmware
from colony.drivers.pioneer.parameters import MODELS
from colony.drivers.pioneer.sip import ConfigSip, EncoderSip, Sip, SipIdentity, StandardSip, read_sip

P3DX = MODELS["p3dx-sh"]


def packets(robot: PioneerFirmware) -> list[Sip | None]:
    return [read_sip(data) for data in decoder().feed(b"".join(robot.sent()))]


def wait(robot: PioneerFirmware, seconds: float, *keep: bytes) -> list[StandardSip]:
    """Let time pass, sending `keep` each second, and return the standard packets."""
    for i in range(round(seconds / STEP_S)):
        if keep and i % round(1.0 / STEP_S) == 0:
            robot.receive(b"".join(keep))
        robot.step()
    return [sip for sip in packets(robot) if isinstance(sip, StandardSip)]


def opened(**options: object) -> PioneerFirmware:
    robot = PioneerFirmware(options.pop("row", P3DX), **options)  # type: ignore[arg-type]
    for number in (0, 1, 2, CommandNumber.OPEN):
        robot.receive(command(number))
    robot.receive(command(CommandNumber.ENABLE, 1))
    robot.sent()
    return robot


def test_the_handshake() -> None:
    robot = PioneerFirmware(P3DX)
    for number in (0, 1):
        robot.receive(command(number))
        assert robot.sent() == [command(number)]
    robot.receive(command(2))
    assert packets(robot) == [SipIdentity(name="Emulated", type="Pioneer", model="p3dx-sh")]
    assert wait(robot, 1.0) == []
    robot.receive(command(CommandNumber.OPEN))
    assert len(wait(robot, 1.0)) == 10


def test_a_wrong_number_begins_the_handshake_again() -> None:
    robot = PioneerFirmware(P3DX)
    robot.receive(command(0) + command(2))
    assert [data[0] for data in decoder().feed(b"".join(robot.sent()))] == [0, 0xFF]
    robot.receive(command(0))
    assert robot.sent() == [command(0)]


def test_it_speeds_up_drives_and_brakes() -> None:
    robot = opened()
    robot.receive(command(CommandNumber.VEL, 300))
    assert [sip.left_speed for sip in wait(robot, 1.0)][4] == pytest.approx(150, abs=2)
    assert robot.speed == 300.0
    robot.receive(command(CommandNumber.STOP))
    wait(robot, 0.5)
    assert robot.speed == pytest.approx(150.0, abs=2.0)
    robot.receive(command(CommandNumber.VEL, 300))
    wait(robot, 1.0)
    robot.receive(command(CommandNumber.ESTOP))
    wait(robot, 0.1)
    assert robot.speed == 0.0


def test_the_watchdog_stops_the_motors_until_the_next_command() -> None:
    robot = opened()
    robot.receive(command(CommandNumber.VEL, 300))
    wait(robot, 1.9)
    assert robot.speed == 300.0
    wait(robot, 1.2)
    assert (robot.is_timed_out, robot.speed) == (True, 0.0)
    x = robot.pose[0]
    wait(robot, 5.0)
    assert robot.pose[0] == x
    robot.receive(command(CommandNumber.PULSE))  # the set point is still there: the trap of pulses
    wait(robot, 1.0)
    assert robot.speed == 300.0


def test_positions_wrap_at_15_bits() -> None:
    robot = opened()
    robot.receive(command(CommandNumber.VEL, -300))
    found = wait(robot, 1.0, command(CommandNumber.PULSE))
    assert found[-1].x == 0x8000 + math.floor(robot.pose[0])


def test_the_register_of_an_older_model_counts_in_its_units() -> None:
    robot = opened(row=MODELS["p2dx"])
    robot.receive(command(CommandNumber.VEL, 300))
    found = wait(robot, 4.0, command(CommandNumber.PULSE))
    assert found[-1].x == math.floor(robot.pose[0] / 0.84)


def test_each_packet_has_the_sonars_that_fired_since_the_last() -> None:
    robot = opened(around=room(4000.0, 6000.0))
    robot.receive(command(CommandNumber.SONAR, 1))
    found = wait(robot, 0.8)
    assert {len(sip.sonars) for sip in found} == {4, 6}
    ranges = {number: mm for sip in found for number, mm in sip.sonars}
    assert sorted(ranges) == list(range(16))
    assert ranges[0] == ranges[7] == 2000 - 136
    assert ranges[3] == pytest.approx(3000 - 166, abs=20)


def test_a_wall_stalls_the_wheels_and_presses_the_bumper() -> None:
    robot = opened(around=room(4000.0, 1000.0))
    found = wait(robot, 4.0, command(CommandNumber.VEL, 200))
    assert robot.pose[0] == pytest.approx(200.0, abs=10.0)
    assert (found[-1].left_stalled, found[-1].right_stalled) == (True, True)
    assert found[-1].front_bumpers == 0b00100
    assert found[-1].rear_bumpers == 0
    assert found[0].front_bumpers == 0
    back = wait(robot, 1.0, command(CommandNumber.VEL, -200))
    assert (back[-1].front_bumpers, back[-1].left_stalled) == (0, False)


def test_the_stop_button_switches_the_motors_off_until_they_are_enabled() -> None:
    robot = opened()
    robot.receive(command(CommandNumber.VEL, 300))
    wait(robot, 1.0)
    robot.stop_button = True
    (*_, last) = wait(robot, 0.3)
    assert (last.flags & 1, last.flags >> 5 & 1, robot.speed) == (0, 1, 0.0)
    robot.stop_button = False
    wait(robot, 0.5)
    assert robot.speed == 0.0
    robot.receive(command(CommandNumber.ENABLE, 1))
    wait(robot, 0.5)
    assert robot.speed > 0.0


def test_it_turns_to_the_left() -> None:
    robot = opened()
    robot.receive(command(CommandNumber.RVEL, 45))
    found = wait(robot, 1.5)
    assert found[-1].heading == pytest.approx(robot.pose[2] * 4096 / 360, abs=1)
    assert found[-1].turn_rate == 450
    assert P3DX.turn_rate(found[-1].left_speed, found[-1].right_speed) == pytest.approx(45.0, abs=0.3)


def test_configuration_and_encoders() -> None:
    robot = opened(watchdog_ms=1500)
    robot.receive(command(CommandNumber.CONFIG, 1) + command(CommandNumber.ENCODER, 1))
    config, encoders = packets(robot)
    assert isinstance(config, ConfigSip)
    assert (config.identity.model, config.watchdog_ms, config.front_bumpers) == ("p3dx-sh", 1500, 5)
    assert encoders == EncoderSip(left=0, right=0)
