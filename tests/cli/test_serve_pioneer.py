"""`colony serve all --robot pioneer --port`: wander and calls drive an emulated Pioneer, by its driver."""

from __future__ import annotations

from contextlib import closing

import pytest

from colony.drivers.emulator import Emulator, room
from colony.drivers.pioneer.firmware import PioneerFirmware
from colony.drivers.pioneer.parameters import MODELS
from colony.runtime.kit.connection import Session
from colony.runtime.library import robot as library
from tests.cli.machine import WANDER, Machine, Started, audited, failed
from tests.waiting import until


def call(machine: Machine, robot: PioneerFirmware, *started: Started) -> None:
    """Hold calls of RServer to what they do in the robot."""
    session = Session.open("pioneer", environment=machine.environment)
    with session, session.connect("RServer", name="test", priority=1000) as base:
        assert robot.bump_stall == 0
        for setting, bumpers in ((1, 3), (0, 0)):
            base.do(library.set_bumper(setting))
            until(lambda at=bumpers: robot.bump_stall == at or failed(*started), "its bumpers are set")  # type: ignore[misc]
        base.do(library.stop(1))
        until(lambda: robot.is_estopped or failed(*started), "it brakes hard")
        until(lambda: robot.speed == 0.0, "it stands")
    until(lambda: robot.speed > 0.0 or failed(*started), "wander drives on")


@pytest.mark.long
def test_wander_drives_until_the_stop_button_is_pressed(machine: Machine) -> None:
    robot = PioneerFirmware(MODELS["p3dx-sh"], around=room(8000.0, 8000.0))
    with closing(Emulator(robot, baud=38400)) as emulator:
        emulator.start()
        port = ("--port", emulator.port, "--baud", "38400")
        served = machine.start("serve", "all", "--robot", "pioneer", *port)
        until(lambda: robot.motors or failed(served), "the robot is ready")
        run = machine.start("drive", WANDER, "--robot", "pioneer", "--record", "run.mcap")
        until(lambda: robot.pose[0] > 500.0 or failed(served, run), "wander drives")
        call(machine, robot, served, run)
        robot.stop_button = True
        until(lambda: robot.speed == 0.0 and robot.set_points == (0.0, 0.0), "it stands, and is told to")
        robot.stop_button = False
        assert run.interrupt() == 130
        assert audited(machine, run)
        assert served.interrupt() == 0
        until(lambda: not robot.is_open, "the session has ended")
    assert "pioneer: Clock, DServer, Limits, RServer, Sonar, Panel, Battery" in served.err
