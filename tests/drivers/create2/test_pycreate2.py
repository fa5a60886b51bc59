"""PyPI's pycreate2 drives the emulated robot, and hears what it measures.

It swaps the sides of packet 7 (the specification and libcreate say bit 0 is the right bumper), gives packets
32 and 33 three bytes each, and has other bits of packet 14. The test says so, so that nobody takes it for an
oracle.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator

import pytest

from colony.drivers.create2.codec import PACKETS, OiMode, size_of
from colony.drivers.create2.firmware import COUNTS_PER_MM, Create2Firmware, EmulatedWorld
from colony.drivers.emulator import Emulator, room

pycreate2 = pytest.importorskip("pycreate2")


@pytest.fixture
def emulator() -> Iterator[Emulator[Create2Firmware]]:
    emulator = Emulator(Create2Firmware(EmulatedWorld(range=room(4000.0, 2000.0))), baud=115_200)
    emulator.start()
    yield emulator
    emulator.close()


def _until(condition: object, robot: object, seconds: float = 20.0) -> object:
    """Read sensors until a condition holds of them."""
    end = time.monotonic() + seconds
    while True:
        sensors = robot.get_sensors()  # type: ignore[attr-defined]
        if condition(sensors):  # type: ignore[operator]
            return sensors
        assert time.monotonic() < end, sensors


def test_it_drives_the_emulator_and_reads_its_sensors(
    emulator: Emulator[Create2Firmware], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pycreate2.Create2, "__del__", lambda self: None)  # it sleeps and sends when collected
    robot = pycreate2.Create2(emulator.port)
    try:
        robot.sleep_timer = 0.05
        robot.start()
        robot.safe()
        sensors = _until(lambda found: found.open_interface_mode == OiMode.SAFE, robot)
        assert (sensors.battery_capacity, sensors.temperature) == (2600, 25)  # type: ignore[attr-defined]
        assert sensors.voltage == 14_000 + sensors.battery_charge  # type: ignore[attr-defined]
        emulator.firmware.pose = (0.0, 0.0, -20.0)
        robot.drive_direct(200, 200)
        sensors = _until(lambda found: found.velocity_right == 200 and found.encoder_counts_left > 100, robot)
        left, right = sensors.encoder_counts_left, sensors.encoder_counts_right  # type: ignore[attr-defined]
        assert left == right
        sensors = _until(lambda found: any(found.bumps_wheeldrops), robot)
        bumps = sensors.bumps_wheeldrops  # type: ignore[attr-defined]
        assert (bumps.bump_left, bumps.bump_right) == (False, True)  # it is the left bumper
        distance = sensors.encoder_counts_left / COUNTS_PER_MM  # type: ignore[attr-defined]
        assert distance == pytest.approx(emulator.firmware.pose[0] / 0.9397, rel=0.05)
        robot.drive_stop()
        robot.stop()
    finally:
        robot.close()


def test_its_faults() -> None:
    codes = importlib.import_module("pycreate2.OI")
    sizes, overcurrents = codes.RESPONSE_SIZES, codes.WHEEL_OVERCURRENT
    assert {number for number in PACKETS if sizes[number] != size_of(number)} == {32, 33}
    assert (overcurrents.RIGHT_WHEEL, overcurrents.LEFT_WHEEL) == (4, 8)  # they are 8 and 16
