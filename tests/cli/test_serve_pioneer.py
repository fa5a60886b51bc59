"""`colony serve all --robot pioneer --port`: wander drives an emulated Pioneer through the real driver."""

from __future__ import annotations

import signal
from contextlib import closing

import pytest

from colony.drivers.emulator import Emulator
from colony.drivers.pioneer.firmware import Firmware
from colony.drivers.pioneer.parameters import MODELS
from colony.drivers.surroundings import room
from tests.cli.machine import WANDER, Machine, failed
from tests.waiting import until


@pytest.mark.long
def test_wander_drives_until_the_stop_button_is_pressed(machine: Machine) -> None:
    robot = Firmware(MODELS["p3dx-sh"], around=room(8000.0, 8000.0))
    with closing(Emulator(robot, baud=38400)) as emulator:
        emulator.start()
        port = ("--port", emulator.port, "--baud", "38400")
        served = machine.start("serve", "all", "--robot", "pioneer", *port)
        until(lambda: robot.motors or failed(served), "the robot is ready")
        run = machine.start("run", WANDER, "--robot", "pioneer", "--connect")
        until(lambda: robot.pose[0] > 500.0 or failed(served, run), "wander drives")
        robot.stop_button = True
        until(lambda: robot.speed == 0.0 and robot.set_points == (0.0, 0.0), "it stands, and is told to")
        robot.stop_button = False
        run.tell(signal.SIGINT)
        assert run.wait() == 130
        served.tell(signal.SIGINT)
        assert served.wait() == 0
        until(lambda: not robot.is_open, "the session has ended")
    assert "pioneer: Clock, RServer, Sonar, Panel, Battery, DServer, Limits" in served.err
