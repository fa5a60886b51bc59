"""The dialect against the emulated robot, with counted time: opening, safe mode, odometry, the stop."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from colony.drivers.create2.codec import (
    STREAM,
    CommandReader,
    OiMode,
    Opcode,
    StreamFrame,
    beam_heard,
    command,
    data_of,
    encoded,
)
from colony.drivers.create2.create2 import Create2
from colony.drivers.create2.firmware import Create2Firmware, EmulatedWorld
from colony.drivers.dialect import ImplausibleError, OpeningError
from colony.drivers.emulator import Pose, room
from tests.drivers.bench import Bench


class Line(Bench[StreamFrame]):
    """The dialect and an emulated robot on one line. Mutable."""

    def __init__(self, robot: Create2Firmware) -> None:
        self.dialect, self.robot = Create2(), robot
        super().__init__(self.dialect, robot)


def opened(robot: Create2Firmware) -> Line:
    """Return a line whose opening has ended."""
    line = Line(robot)
    line.open(1.5)
    assert robot.mode == OiMode.SAFE
    return line


def test_the_opening_starts_streams_and_enters_safe_mode_once() -> None:
    line = opened(Create2Firmware())
    opcodes = [opcode for opcode, _ in CommandReader().feed(bytes(line.sent))]
    assert opcodes == [Opcode.START] * 6 + [Opcode.STREAM, Opcode.SAFE]


def test_a_command_that_was_cut_off_before_does_not_matter() -> None:
    robot = Create2Firmware()
    robot.receive(command(Opcode.START) + command(Opcode.SAFE) + bytes([Opcode.DRIVE_DIRECT, 0]))
    opened(robot)


def test_nobody_answers() -> None:
    line = Line(Create2Firmware())
    line.robot.receive = lambda data: None  # type: ignore[method-assign]
    with pytest.raises(OpeningError, match="no Create answers"):
        line.run(8.0)


def test_the_charger_keeps_it_from_safe_mode() -> None:
    line = Line(Create2Firmware())
    line.robot.plugged = True
    with pytest.raises(OpeningError, match="does not enter safe mode: its charger"):
        line.run(3.0)


@pytest.mark.parametrize("latency_s", [0.0, 0.1, 0.5, 0.9])
def test_frames_of_before_do_not_matter_where_the_computer_is_slow(latency_s: float) -> None:
    line = Line(Create2Firmware())
    line.latency_s = latency_s
    line.open(5.5)
    line.begin()
    line.run(4.0, (100.0, 0.0))
    line.open(1.5)
    assert line.robot.mode == OiMode.SAFE


def test_leaving_safe_mode_is_a_fault_that_is_never_undone_silently() -> None:
    line = opened(Create2Firmware())
    line.run(1.0, (200.0, 0.0))
    line.robot.drops = (True, False)
    with pytest.raises(OpeningError, match=r"left safe mode \(a wheel hangs\)"):
        line.run(0.1)
    line.robot.drops = (False, False)
    before = len(line.sent)
    with pytest.raises(OpeningError, match="start RServer again"):
        line.begin()
    line.robot.step()
    assert len(line.sent) == before
    assert line.robot.mode == OiMode.PASSIVE


def test_a_cliff_ahead_stops_it_and_is_a_fault() -> None:
    line = opened(Create2Firmware(EmulatedWorld(floor=lambda x, y: x < 500.0)))
    with pytest.raises(OpeningError, match="a cliff"):
        line.run(5.0, (200.0, 0.0))
    assert line.robot.pose[0] < 400.0


def test_a_listening_dialect_takes_no_fault() -> None:
    values = {"mode": 1, "voltage": 15_000, "charge": 1_300, "capacity": 2_600}
    frame = StreamFrame(STREAM, data_of(STREAM, values))
    assert Create2().read(frame, 0).fields["battery"] == 50.0


@pytest.mark.parametrize("turn", [0.0, 20.0, -45.0])
def test_dead_reckoning_follows_the_robot_beyond_the_wrap(turn: float) -> None:
    line = opened(Create2Firmware())
    for _ in range(2 if turn else 8):
        line.run(10.0, (450.0 if not turn else 300.0, turn))
    x, y, heading = line.robot.pose
    if not turn:
        assert x > 65_536 * 0.4446
    assert math.remainder(line.base.heading - heading, 360.0) == pytest.approx(0.0, abs=2.0)
    assert line.base.x == pytest.approx(-y, abs=40.0)
    assert line.base.y == pytest.approx(x, abs=40.0)
    assert line.base.speed == pytest.approx(450.0 if not turn else 300.0, abs=10.0)
    assert line.base.turn_rate == pytest.approx(turn, abs=4.0)


@pytest.mark.thorough
@pytest.mark.parametrize("speed", [500.0, -500.0])
def test_a_long_way_wraps_the_encoders_again_and_again(speed: float) -> None:
    """Encoders of 16 bits: 29.1 m."""
    line = opened(Create2Firmware())
    line.run(180.0, (speed, 0.0))
    line.run(1.0, (0.0, 0.0))
    assert abs(line.robot.pose[0]) > 3 * 65_536 * 0.4446
    assert line.base.y == pytest.approx(line.robot.pose[0], rel=1e-4)


def test_a_speed_holds_without_a_watchdog_and_the_stop_of_the_guard_ends_it() -> None:
    line = opened(Create2Firmware())
    line.run(1.0, (300.0, 0.0))
    line.run(10.0)
    assert line.robot.wheels == (300.0, 300.0)
    line.send(bytes([Opcode.DRIVE_DIRECT, 1]))  # a command that was cut off
    line.send(line.dialect.stop_bytes)
    line.run(0.4)
    assert not any(line.robot.wheels)


def test_it_drives_by_duty_cycles() -> None:
    line = opened(Create2Firmware())
    line.send(command(Opcode.DRIVE_PWM, 0, 128, 0xFF, 0x80))  # right, left
    line.run(0.5)
    assert line.robot.wheels == (-251.0, 251.0)


def test_data_of_commands_are_no_opcodes() -> None:
    line = opened(Create2Firmware())
    line.send(command(Opcode.PWM_MOTORS, Opcode.POWER, Opcode.POWER, 64))  # brushes that turn backward
    line.send(command(Opcode.SCHEDULE, *[Opcode.STOP] * 15))
    assert line.robot.mode == OiMode.SAFE


@pytest.mark.parametrize("opcode", [Opcode.SPOT, Opcode.CLEAN, Opcode.MAX, Opcode.DOCK, Opcode.POWER])
def test_programs_of_the_robot_leave_safe_mode(opcode: Opcode) -> None:
    line = opened(Create2Firmware())
    line.send(command(opcode))
    assert line.robot.mode == OiMode.PASSIVE


def test_bumper_and_stall_at_a_wall_to_the_left() -> None:
    line = opened(Create2Firmware(EmulatedWorld(range=room(4000.0, 2000.0))))
    line.robot.pose = (0.0, 0.0, -20.0)  # the wall ahead is nearest to the left
    line.run(6.0, (200.0, 0.0))
    readings = line.measured.readings(line.now_ns)
    assert readings["bumper"].value == (True, False)
    assert readings["range"].value[1] < 40.0 < readings["range"].value[4]  # type: ignore[index, operator]
    assert readings["stalled"].value is True
    assert line.base.front_bumper


@pytest.mark.parametrize(
    ("pose", "red", "green", "field"),
    [
        ((1000.0, 0.0, 0.0), (True, True, True), (True, True, True), (False, False, False)),
        ((1000.0, 400.0, 0.0), (False, True, True), (False,) * 3, (False,) * 3),
        ((1000.0, -400.0, -50.0), (False,) * 3, (False, True, False), (False,) * 3),
        ((1600.0, 0.0, 0.0), (True, True, True), (True, True, True), (True, True, True)),
        ((1600.0, 0.0, 180.0), (False, True, False), (False, True, False), (False, True, False)),
        ((-2000.0, 0.0, 0.0), (False,) * 3, (False,) * 3, (False,) * 3),
    ],
)
def test_the_receivers_hear_the_beams_of_a_dock(
    pose: Pose, red: tuple[bool, ...], green: tuple[bool, ...], field: tuple[bool, ...]
) -> None:
    line = opened(Create2Firmware(EmulatedWorld(dock=(2000.0, 0.0, 0.0))))
    line.robot.pose = pose
    line.run(0.1)
    readings = line.measured.readings(line.now_ns)
    assert [readings[name].value for name in ("dock_red", "dock_green", "dock_field")] == [red, green, field]


def test_a_robot_at_its_dock_charges() -> None:
    line = opened(Create2Firmware(EmulatedWorld(dock=(100.0, 0.0, 0.0))))
    assert line.measured.readings(line.now_ns)["docked"].value is False
    line.robot.pose = (90.0, 0.0, 0.0)
    line.run(0.1)
    readings = line.measured.readings(line.now_ns)
    assert (readings["docked"].value, readings["charging"].value) == (True, True)


@pytest.mark.parametrize(
    ("character", "beams"),
    [(0, 0), (160, 0), (161, 1), (164, 4), (165, 5), (168, 8), (169, 9), (172, 12), (173, 13)],
)
def test_characters_of_the_dock_in_the_specification(character: int, beams: int) -> None:
    assert sum(beam for beam in (1, 4, 8) if beam_heard(character, beam)) == beams


@pytest.mark.parametrize("character", [129, 130, 136, 162, 255])  # remote controls, a virtual wall
def test_what_others_send_is_no_dock(character: int) -> None:
    assert not any(beam_heard(character, beam) for beam in (1, 4, 8))


def test_wheels_are_slowed_down_together() -> None:
    (_, data), *_ = CommandReader().feed(Create2().drive(500.0, 90.0))
    right, left = int.from_bytes(data[:2], "big", signed=True), int.from_bytes(data[2:], "big", signed=True)
    assert right == 500
    assert math.degrees((right - left) / 235.0) / ((right + left) / 2.0) == pytest.approx(90 / 500, rel=0.01)


@pytest.mark.parametrize(("name", "value"), [("voltage", 40_000), ("light_bumper", 64), ("mode", 32)])
def test_what_is_not_possible_is_refused(name: str, value: int) -> None:
    frame = StreamFrame(STREAM, data_of(STREAM, {"voltage": 15_000, name: value}))
    assert Create2().decoder().feed(encoded(frame)) == [frame]
    with pytest.raises(ImplausibleError, match=name):
        Create2().read(replace(frame), 0)
