"""`colony serve all --robot create2 --port`: bounce drives an emulated Create 2 through the real driver."""

from __future__ import annotations

import signal
from contextlib import closing

import pytest

from colony.drivers.create2.firmware import Firmware, World
from colony.drivers.create2.sensors import Mode
from colony.drivers.emulator import Emulator
from colony.drivers.surroundings import room
from tests.cli.machine import Machine, audited, failed
from tests.paths import ROOT
from tests.waiting import until

LEFT_SAFE_MODE = "left safe mode (a wheel hangs)"


@pytest.mark.long
def test_bounce_drives_until_the_robot_is_lifted(machine: Machine) -> None:
    robot = Firmware(World(range=room(3000.0, 2000.0)))
    with closing(Emulator(robot, baud=115_200)) as emulator:
        emulator.start()
        served = machine.start("serve", "all", "--robot", "create2", "--port", emulator.port)
        until(lambda: robot.mode == Mode.SAFE or failed(served), "the robot is ready")
        bounce = str(ROOT / "behaviors" / "bounce.colony")
        run = machine.start("run", bounce, "--robot", "create2", "--connect", "--record", "run.mcap")
        until(lambda: robot.pose[0] > 300.0 or failed(served, run), "bounce drives")
        robot.drops = (True, True)
        until(lambda: robot.wheels == (0.0, 0.0), "it stands")
        until(lambda: LEFT_SAFE_MODE in served.err or failed(served, run), "the driver reports it")
        run.tell(signal.SIGINT)
        assert run.wait() == 130
        assert audited(machine, run)
        served.tell(signal.SIGINT)
        assert served.wait() == 0
    assert LEFT_SAFE_MODE in served.err
    assert "nothing stops `RServer` when its computer fails" in served.err
