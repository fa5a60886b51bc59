"""The emulator's line has the pace of its baud rate, and the real driver drives it, by way of the guard."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tty
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from colony.drivers.emulator import Emulator, room
from colony.drivers.pioneer.codec import CommandNumber, command, decoder
from colony.drivers.pioneer.firmware import PioneerFirmware
from colony.drivers.pioneer.parameters import MODELS
from colony.drivers.pioneer.pioneer import base
from tests.waiting import killed_in_the_end, until

P3DX = MODELS["p3dx-sh"]


class Time:
    """A clock that is moved by hand. Mutable."""

    def __init__(self) -> None:
        self.s = 0.0

    def __call__(self) -> float:
        return self.s


@contextmanager
def line(emulator: Emulator[PioneerFirmware]) -> Iterator[int]:
    """Open the other end."""
    end = os.open(emulator.port, os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY)
    tty.setraw(end)
    try:
        yield end
    finally:
        os.close(end)
        emulator.close()


def heard(end: int) -> bytes:
    try:
        return os.read(end, 65536)
    except BlockingIOError:
        return b""


def test_an_answer_takes_the_time_of_its_bytes_both_ways() -> None:
    now = Time()
    emulator = Emulator(PioneerFirmware(P3DX), baud=1200, clock=now)  # 120 bytes a second
    with line(emulator) as end:
        os.write(end, command(0) * 6)  # 36 bytes: 0.3 s
        arrived = []
        for _ in range(40):
            now.s += 0.01
            emulator.catch_up()
            arrived.append(len(heard(end)))
    assert sum(arrived[:4]) == 0
    assert 0 < sum(arrived[:20]) <= 24
    assert max(arrived) <= 3


@pytest.mark.parametrize(("baud", "least", "most"), [(9600, 18, 21), (1200, 2, 8)])
def test_a_slow_line_loses_packets_and_no_bytes_of_packets(baud: int, least: int, most: int) -> None:
    now = Time()
    emulator = Emulator(PioneerFirmware(P3DX, around=room(4000.0, 6000.0)), baud=baud, clock=now)
    for packet in (*map(command, (0, 1, 2, CommandNumber.OPEN)), command(CommandNumber.SONAR, 1)):
        emulator.firmware.receive(packet)
    emulator.firmware.sent()
    with line(emulator) as end:
        stream = b""
        for _ in range(400):
            now.s += 0.005
            emulator.catch_up()
            stream += heard(end)
    packets = decoder().feed(stream)
    assert len(stream) <= 2.0 * baud / 10.0 + 16.0
    assert least <= len(packets) <= most
    assert {data[0] for data in packets} == {0x32}


def test_what_is_on_the_line_is_lost_with_the_cable_and_the_robot_goes_on(tmp_path: Path) -> None:
    now = Time()
    emulator = Emulator(PioneerFirmware(P3DX), baud=1200, clock=now, link=tmp_path / "port")

    def passes(seconds: float) -> None:
        for _ in range(round(seconds / 0.01)):
            now.s += 0.01
            emulator.catch_up()

    with line(emulator) as end:
        os.write(end, command(0))
        passes(0.02)
        emulator.pull_out()
        assert not (tmp_path / "port").exists()
        passes(2.0)
        assert emulator.firmware.is_timed_out
        emulator.plug_in()
        with closing(open(emulator.port, "r+b", buffering=0)) as other:
            os.set_blocking(other.fileno(), False)
            passes(0.1)
            assert other.read() is None  # no answer to what was lost
            other.write(command(0))
            passes(0.2)
            assert decoder().feed(other.read() or b"") == [b"\0"]


def test_the_command_pulls_its_cable_at_signals(tmp_path: Path) -> None:
    link = tmp_path / "port"
    process = subprocess.Popen(
        [sys.executable, "-m", "colony.drivers.pioneer.emulator", "--link", link],
        stdout=subprocess.PIPE,
        text=True,
    )
    with killed_in_the_end(process):
        assert process.stdout.readline() == f"{link}\n"
        process.send_signal(signal.SIGUSR1)
        until(lambda: not link.is_symlink(), "the cable is out")
        process.send_signal(signal.SIGUSR2)
        assert process.stdout.readline() == f"{link}\n"
        process.send_signal(signal.SIGTERM)
        assert process.wait() == 0
    assert not link.is_symlink()


def test_the_driver_drives_it_and_the_guard_stops_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLONY_RUN_DIR", str(tmp_path))
    robot = PioneerFirmware(P3DX)
    with closing(Emulator(robot, baud=38400)) as emulator:
        emulator.start()
        with closing(base(emulator.port, frame_ns=50_000_000, baud=38400, acceleration=2000.0)) as driver:
            until(lambda: driver.problem is None and driver.state() is not None, "the robot is ready")

            def drives() -> bool:
                driver.drive(200.0, 0.0)
                return robot.speed == 200.0

            until(drives, "it drives")
            until(
                lambda: robot.set_points == (0.0, 0.0) and robot.speed == 0.0,
                "it is stopped: no frame is decided",
            )
            until(drives, "it drives again")
            driver.stop()
            until(lambda: robot.speed == 0.0, "it stands")
            state = driver.state()
            assert state.y > 0.0
        until(lambda: not robot.is_open, "the guard has ended the session")
