"""The dialect: the handshake, what packets measure, what a frame sends."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

import pytest

from colony.drivers.dialect import ImplausibleError, OpeningError
from colony.drivers.emulator import room
from colony.drivers.pioneer import pioneer
from colony.drivers.pioneer.codec import CommandNumber, argument_of, command, decoder
from colony.drivers.pioneer.firmware import PioneerFirmware
from colony.drivers.pioneer.parameters import MODELS
from colony.drivers.pioneer.pioneer import Pioneer
from tests.drivers.bench import Bench


class Line(Bench[bytes]):
    """The dialect and an emulated robot on one line. Mutable."""

    def __init__(
        self, dialect: Pioneer, robot: PioneerFirmware, *, hears: Callable[[bytes], bool] = bool
    ) -> None:
        self.dialect, self.robot = dialect, robot
        super().__init__(dialect, robot, hears=hears)

    @property
    def packets(self) -> list[bytes]:
        """The data of the packets that were sent to the robot."""
        return decoder().feed(bytes(self.sent))


def line_of(**options: int | str | None) -> Line:
    row = MODELS[str(options.get("model", "p3dx-sh"))]
    return Line(Pioneer(**options), PioneerFirmware(row, around=room(4000.0, 6000.0)))  # type: ignore[arg-type]


def opened(**options: int | str | None) -> Line:
    line = line_of(**options)
    line.open(4.0)
    return line


def test_the_handshake_ends_with_enabled_motors_and_sonars() -> None:
    line = opened(acceleration=500)
    assert [data[0] for data in line.packets] == [0, 1, 2, 1, 18, 4, 28, 5, 5]
    assert [argument_of(data) for data in line.packets[-4:]] == [1, 1, 500, -500]
    assert line.robot.motors


def test_settings_that_are_lost_are_sent_again() -> None:
    line = line_of()
    send, lost = line.robot.receive, list[bytes]()

    def loses_the_first_settings(data: bytes) -> None:
        if not lost and command(CommandNumber.ENABLE, 1) in data:
            lost.append(data)
        else:
            send(data)

    line.robot.receive = loses_the_first_settings  # type: ignore[method-assign]
    line.open(6.0)
    assert lost
    assert line.robot.motors


def test_a_pressed_stop_button_is_no_reason_to_wait() -> None:
    line = line_of()
    line.robot.stop_button = True
    line.run(10.0)
    assert line.opening.is_done
    assert not line.robot.motors


def _in_session(line: Line) -> Line:
    """Drive the robot by another program, which has gone."""
    for packet in (0, 1, 2, CommandNumber.OPEN):
        line.robot.receive(command(packet))
    line.robot.receive(command(CommandNumber.ENABLE, 1) + command(CommandNumber.VEL, 200))
    return line


def test_an_older_session_goes_on_and_stands() -> None:
    line = _in_session(line_of())
    line.open(4.0)
    stop = [CommandNumber.ESTOP, CommandNumber.VEL, CommandNumber.RVEL]
    assert [data[0] for data in line.packets[:6]] == [
        *stop,
        CommandNumber.CONFIG,
        CommandNumber.ENABLE,
        CommandNumber.SONAR,
    ]
    assert line.robot.set_points == (0.0, 0.0)


def test_an_older_session_without_a_configuration_is_closed_first() -> None:
    line = _in_session(
        Line(Pioneer(), PioneerFirmware(MODELS["p3dx-sh"]), hears=lambda data: data[0] != 0x20)
    )
    line.open(4.0)
    assert [data[0] for data in line.packets[3:8]] == [CommandNumber.CONFIG, CommandNumber.CLOSE, 0, 1, 2]
    assert line.robot.set_points == (0.0, 0.0)


@pytest.mark.parametrize("in_session", [False, True])
def test_another_model_is_refused_also_in_an_older_session(in_session: bool) -> None:
    line = Line(Pioneer("p3at-sh"), PioneerFirmware(MODELS["p3dx-sh"]))
    line = _in_session(line) if in_session else line
    with pytest.raises(OpeningError, match="Emulated is a p3dx-sh, and the body says model = 'p3at-sh'"):
        line.open(4.0)
    assert line.robot.set_points == (0.0, 0.0)


def test_a_configuration_that_never_arrives_is_done_without() -> None:
    """Some robots send it with a wrong checksum, always: it is as if there were none."""
    line = Line(Pioneer(), PioneerFirmware(MODELS["p3dx-sh"]), hears=lambda data: data[0] != 0x20)
    line.open(4.0)
    assert line.robot.motors


def test_a_robot_without_a_watchdog_is_refused() -> None:
    line = Line(Pioneer(), PioneerFirmware(MODELS["p3dx-sh"], watchdog_ms=0))
    with pytest.raises(OpeningError, match="watchdog is off"):
        line.open(4.0)
    assert not line.robot.motors


def test_nobody_answers() -> None:
    line = Line(Pioneer(), PioneerFirmware(MODELS["p3dx-sh"]), hears=lambda data: False)
    with pytest.raises(OpeningError, match=r"no Pioneer answers.*baud rate 9600"):
        line.run(8.0)


def test_nothing_is_sent_while_no_frame_is_decided() -> None:
    line = opened()
    before = len(line.sent)
    line.run(5.0)
    assert len(line.sent) == before
    assert line.robot.is_timed_out


@pytest.mark.parametrize("model", ["p3dx-sh", "p2dx", "pion1x"])
def test_dead_reckoning_follows_the_robot(model: str) -> None:
    line = Line(Pioneer(model), PioneerFirmware(MODELS[model]))
    line.open(4.0)
    line.run(20.0, (300.0, 20.0))
    line.run(12.0, (300.0, 0.0))
    x, y, heading = line.robot.pose
    unit = 360.0 / MODELS[model].turn_units
    assert math.remainder(line.base.heading - heading, 360.0) == pytest.approx(0.0, abs=unit)
    assert (line.base.x, line.base.y) == (pytest.approx(-y, abs=50.0), pytest.approx(x, abs=50.0))
    assert math.hypot(x, y) > 2_000.0  # and x was negative, beyond the wrap
    assert line.base.speed == pytest.approx(300.0, abs=3.0)


@pytest.mark.parametrize(("model", "speed"), [("p3dx-sh", 1500), ("p2dx", -1200)])
@pytest.mark.thorough
def test_a_long_way_wraps_the_registers_again_and_again(model: str, speed: int) -> None:
    """Registers of 15 bits: 32.8 m of a p3dx-sh, 27.5 m of a p2dx."""
    line = Line(Pioneer(model), PioneerFirmware(MODELS[model]))
    line.open(4.0)
    line.run(75.0, (speed, 0.0))
    line.run(8.0, (0.0, 0.0))
    assert abs(line.robot.pose[0]) > 3 * 0x8000 * MODELS[model].distance
    assert line.base.y == pytest.approx(line.robot.pose[0], abs=2.0)


def test_dead_reckoning_goes_on_after_the_line_begins_again() -> None:
    line = opened()
    line.run(3.0, (300.0, 0.0))
    y = line.base.y
    line.dialect.restart()
    line.robot.receive(command(CommandNumber.SETO))
    line.run(1.0, (300.0, 0.0))
    assert line.base.y == pytest.approx(y + 270.0, abs=40.0)


def test_a_ring_is_complete_within_half_a_second_and_as_old_as_its_oldest_element() -> None:
    line = opened()
    line.run(1.0, (0.0, 0.0))
    ring = line.measured.readings(line.now_ns)["sonar"]
    assert ring.value[3] == pytest.approx(3000.0 - 166.0, abs=30.0)  # type: ignore[index]
    assert 280_000_000 <= ring.age_ns <= 400_000_000
    assert ring.age_ns + line.dialect.delay_ns < 700_000_000


def test_bumpers_that_are_not_there_are_not_pressed() -> None:
    (recorded,) = decoder().feed(
        bytes.fromhex(
            "FAFB213200000000000000000000 90FEFE0000000000020400 7D07007D05005930F011B4".replace(" ", "")
        )
    )
    for segments, pressed in ((0, False), (5, True)):
        dialect = Pioneer("p2dx", front_bumpers=segments, rear_bumpers=segments)
        base = dialect.read(recorded, 0).base
        assert (base.front_bumper, base.rear_bumper) == (pressed, pressed)
    readings = dialect.read(recorded, 0)
    assert readings.elements["sonar"] == {4: math.inf, 7: math.inf}
    assert readings.fields == {"volts": 14.4, "battery": 100.0, "stalled": False}  # its flags are others


def test_the_stop_of_the_guard_brakes_hard_and_leaves_nothing_to_go_on_with() -> None:
    line = opened(acceleration=500)
    line.run(2.0, (600.0, 0.0))
    assert line.robot.speed == 600.0
    line.send(line.dialect.stop_bytes)
    line.run(0.2)
    assert line.robot.speed == 0.0
    line.send(command(CommandNumber.PULSE))
    line.run(1.0)
    assert line.robot.speed == 0.0
    line.run(2.0, (100.0, 0.0))
    assert line.robot.speed == 100.0


def test_set_bumper_reaches_the_robot_with_the_next_frame_and_is_repeated() -> None:
    line = Line(Pioneer(front_bumpers=5, rear_bumpers=0), PioneerFirmware(MODELS["p3dx-sh"]))
    line.open(4.0)
    assert line.robot.bump_stall == 0
    line.dialect.watch_bumpers(True)
    line.run(1.0)
    assert line.robot.bump_stall == 0  # nothing was decided
    line.run(0.05, (0.0, 0.0))
    assert line.robot.bump_stall == 1
    line.robot.bump_stall = 0  # as if it had been lost on the line
    line.run(1.0, (0.0, 0.0))
    assert line.robot.bump_stall == 1
    line.dialect.watch_bumpers(False)
    line.run(0.05, (0.0, 0.0))
    assert line.robot.bump_stall == 0


@pytest.mark.parametrize(("watched", "gap"), [(True, 8.0), (False, 0.0)])
def test_a_robot_that_watches_its_bumpers_stops_at_the_first_touch(watched: bool, gap: float) -> None:
    line = opened(front_bumpers=5, acceleration=500)
    line.dialect.watch_bumpers(watched)
    line.run(9.0, (350.0, 0.0))
    assert 3000.0 - 300.0 - line.robot.pose[0] == pytest.approx(gap, abs=2.0)
    line.run(1.0, (-200.0, 0.0))
    assert line.robot.speed == -200.0


@pytest.mark.parametrize("joystick", [False, True])
def test_a_joystick_at_the_robot_drives_it_only_if_it_may(joystick: bool) -> None:
    line = opened(joystick=joystick)
    line.robot.joystick = (100.0, 0.0)
    line.run(2.0, (0.0, 0.0))
    assert line.robot.speed == (100.0 if joystick else 0.0)


def test_a_shorter_cycle_gives_a_younger_ring() -> None:
    line = opened(sonar_cycle=20)
    line.run(1.0, (0.0, 0.0))
    assert line.measured.readings(line.now_ns)["sonar"].age_ns <= 240_000_000
    assert line.robot.speed == 0.0


def test_it_does_not_drive_sideways() -> None:
    with pytest.raises(ValueError, match="sideways"):
        Pioneer().drive(0.0, 0.0, 1.0)


def test_options_that_no_robot_has() -> None:
    with pytest.raises(ValueError, match="no model 'labmate'; known are amigo"):
        Pioneer("labmate")
    with pytest.raises(ValueError, match="sonars is 17; a p3dx-sh has up to 16"):
        Pioneer(sonars=17)
    with pytest.raises(ValueError, match="8 segments"):
        Pioneer(front_bumpers=8)
    with pytest.raises(ValueError, match="sonar_cycle is 200 ms; 2 to 120"):
        Pioneer(sonar_cycle=200)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"joystick": "no"}, "joystick is 'no'; it is true or false"),
        ({"joystick": 0.0}, "joystick is 0.0; it is true or false"),
        ({"model": 7.0}, "model is 7.0; it is a text"),
        ({"sonar_cycle": "fast"}, "sonar_cycle is 'fast'; it is a number"),
        ({"front_bumpers": True}, "front_bumpers is True; it is a number"),
    ],
)
def test_options_of_another_kind(options: dict[str, bool | float | str], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        pioneer._dialect(0, options)


def test_registers_that_move_faster_than_the_robot_are_refused() -> None:
    """Also where the heading's register, whose units are smaller, could count as fast."""
    line = opened()
    data = b"\x32" + struct.pack("<HH", 1500, 0) + bytes(19)
    with pytest.raises(ImplausibleError, match=r"registers \(0, 0\) became \(1500, 0\)"):
        line.dialect.read(data, line.now_ns + 200_000_000)
