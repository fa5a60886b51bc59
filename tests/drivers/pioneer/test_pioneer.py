"""The dialect: the handshake, what packets measure, what a frame sends."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

import pytest

from colony.drivers.dialect import ImplausibleError, OpeningError
from colony.drivers.emulator import STEP_S
from colony.drivers.measurements import Measurements
from colony.drivers.opening import OpeningRun
from colony.drivers.pioneer.codec import Command, argument_of, command, decoder
from colony.drivers.pioneer.firmware import Firmware
from colony.drivers.pioneer.parameters import MODELS
from colony.drivers.pioneer.pioneer import Pioneer
from colony.drivers.surroundings import room
from colony.runtime.servers.drivers import BaseState

STEP_NS = round(STEP_S * 1e9)


class Bench:
    """A dialect and an emulated robot on one line without loss; time is counted. Mutable."""

    def __init__(self, dialect: Pioneer, robot: Firmware, *, hears: Callable[[bytes], bool] = bool) -> None:
        self.dialect, self.robot, self._hears = dialect, robot, hears
        self.now_ns, self.sent = 0, list[bytes]()
        self._decoder = dialect.decoder()
        self.measured = Measurements(
            rings=dialect.rings, bounds=dialect.bounds, max_speed=dialect.max_speed, max_turn=dialect.max_turn
        )
        self.opening = OpeningRun(dialect.opening(), self.send, 0)

    def send(self, data: bytes) -> None:
        self.sent += decoder().feed(data)
        self.robot.receive(data)

    def run(self, seconds: float, drive: tuple[float, float] | None = None) -> None:
        """Let time pass; with `drive`, each 50 ms a frame decides for it."""
        for i in range(round(seconds / STEP_S)):
            if drive and i % 10 == 0:
                self.send(self.dialect.drive(*drive))
            self.now_ns += STEP_NS
            self.robot.step()
            for data in self._decoder.feed(b"".join(self.robot.sent())):
                if self._hears(data):
                    self.opening.on_packet(data, self.now_ns)
                    self.measured.take(self.dialect.read(data, self.now_ns), self.now_ns)
            self.opening.on_time(self.now_ns)

    def open(self) -> Bench:
        self.run(4.0)
        assert self.opening.is_done
        return self

    @property
    def base(self) -> BaseState:
        assert self.measured.base is not None
        return self.measured.base


def bench(**options: int | str | None) -> Bench:
    row = MODELS[str(options.get("model", "p3dx-sh"))]
    return Bench(Pioneer(**options), Firmware(row, around=room(4000.0, 6000.0)))  # type: ignore[arg-type]


def test_the_handshake_ends_with_enabled_motors_and_sonars() -> None:
    line = bench(acceleration=500).open()
    assert [data[0] for data in line.sent] == [0, 1, 2, 1, 18, 4, 28, 5, 5]
    assert [argument_of(data) for data in line.sent[-4:]] == [1, 1, 500, -500]
    assert line.robot.motors


def test_settings_that_are_lost_are_sent_again() -> None:
    line = bench()
    send, lost = line.robot.receive, list[bytes]()

    def loses_the_first_settings(data: bytes) -> None:
        if not lost and command(Command.ENABLE, 1) in data:
            lost.append(data)
        else:
            send(data)

    line.robot.receive = loses_the_first_settings  # type: ignore[method-assign]
    line.open()
    assert lost
    assert line.robot.motors


def test_a_pressed_stop_button_is_no_reason_to_wait() -> None:
    line = bench()
    line.robot.stop_button = True
    line.run(10.0)
    assert line.opening.is_done
    assert not line.robot.motors


def test_an_older_session_is_closed_first() -> None:
    line = bench()
    for number in (0, 1, 2, Command.OPEN):
        line.robot.receive(command(number))
    line.open()
    assert [data[0] for data in line.sent[:3]] == [0, Command.CLOSE, 0]


def test_a_configuration_that_never_arrives_is_done_without() -> None:
    """Some robots send it with a wrong checksum, always: it is as if there were none."""
    line = Bench(Pioneer(), Firmware(MODELS["p3dx-sh"]), hears=lambda data: data[0] != 0x20)
    line.open()
    assert line.robot.motors


def test_another_model_is_refused() -> None:
    line = Bench(Pioneer("p3at-sh"), Firmware(MODELS["p3dx-sh"]))
    with pytest.raises(OpeningError, match="Emulated is a p3dx-sh, and the body says model = 'p3at-sh'"):
        line.open()


def test_a_robot_without_a_watchdog_is_refused() -> None:
    line = Bench(Pioneer(), Firmware(MODELS["p3dx-sh"], watchdog_ms=0))
    with pytest.raises(OpeningError, match="watchdog is off"):
        line.open()
    assert not line.robot.motors


def test_nobody_answers() -> None:
    line = Bench(Pioneer(), Firmware(MODELS["p3dx-sh"]), hears=lambda data: False)
    with pytest.raises(OpeningError, match=r"no Pioneer answers.*baud rate 9600"):
        line.run(8.0)


def test_nothing_is_sent_while_no_frame_is_decided() -> None:
    line = bench().open()
    before = len(line.sent)
    line.run(5.0)
    assert len(line.sent) == before
    assert line.robot.is_timed_out


@pytest.mark.parametrize("model", ["p3dx-sh", "p2dx", "pion1x"])
def test_dead_reckoning_follows_the_robot(model: str) -> None:
    line = Bench(Pioneer(model), Firmware(MODELS[model]))
    line.open()
    line.run(20.0, (300.0, 20.0))
    line.run(12.0, (300.0, 0.0))
    x, y, heading = line.robot.pose
    unit = 360.0 / MODELS[model].turn_units
    assert math.remainder(line.base.heading - heading, 360.0) == pytest.approx(0.0, abs=unit)
    assert (line.base.x, line.base.y) == (pytest.approx(-y, abs=50.0), pytest.approx(x, abs=50.0))
    assert math.hypot(x, y) > 2_000.0  # and x was negative, beyond the wrap
    assert line.base.speed == pytest.approx(300.0, abs=3.0)


def test_dead_reckoning_goes_on_after_the_line_begins_again() -> None:
    line = bench().open()
    line.run(3.0, (300.0, 0.0))
    y = line.base.y
    line.dialect.restart()
    line.robot.receive(command(Command.SETO))
    line.run(1.0, (300.0, 0.0))
    assert line.base.y == pytest.approx(y + 270.0, abs=40.0)


def test_a_ring_is_complete_within_half_a_second_and_as_old_as_its_oldest_element() -> None:
    line = bench().open()
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
        assert base is not None
        assert (base.front_bumper, base.rear_bumper) == (pressed, pressed)
    readings = dialect.read(recorded, 0)
    assert readings.elements["sonar"] == {4: math.inf, 7: math.inf}
    assert readings.fields == {"volts": 14.4, "battery": 100.0, "stalled": False}  # its flags are others


def test_the_stop_of_the_guard_brakes_hard_and_leaves_nothing_to_go_on_with() -> None:
    line = bench(acceleration=500).open()
    line.run(2.0, (600.0, 0.0))
    assert line.robot.speed == 600.0
    line.send(line.dialect.stop_bytes)
    line.run(0.2)
    assert line.robot.speed == 0.0
    line.send(command(Command.PULSE))
    line.run(1.0)
    assert line.robot.speed == 0.0
    line.run(2.0, (100.0, 0.0))
    assert line.robot.speed == 100.0


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


def test_registers_that_move_faster_than_the_robot_are_refused() -> None:
    """Also where the heading's register, whose units are smaller, could count as fast."""
    line = bench().open()
    data = b"\x32" + struct.pack("<HH", 1500, 0) + bytes(19)
    with pytest.raises(ImplausibleError, match=r"registers \(0, 0\) became \(1500, 0\)"):
        line.dialect.read(data, line.now_ns + 200_000_000)
