"""`colony serve --port`: the robot of docs/drivers.md drives over a pseudoterminal."""

from __future__ import annotations

import os
import signal
from contextlib import closing
from pathlib import Path

import pytest

from colony.drivers.create2.codec import OiMode
from colony.drivers.create2.firmware import Create2Firmware, EmulatedWorld
from colony.drivers.emulator import Emulator, room
from tests.cli.conftest import Colony
from tests.cli.machine import Machine, audited, failed
from tests.drivers.test_guard import guard_pid, guard_runs
from tests.drivers.tiny import GOODBYE, SPEEDS, Tiny
from tests.drivers.tiny_robot import TinyRobot
from tests.pages import write_files
from tests.paths import ROOT
from tests.waiting import until


@pytest.mark.long
def test_the_robot_of_the_page(machine: Machine, tmp_path: Path) -> None:
    write_files("drivers.md", tmp_path)
    drivers = tmp_path / "robots" / "rover" / "rover_drivers.py"
    patient = "    baud = 115200\n    silent_s = 600.0\n"  # so that the gripper finds a frozen guard
    drivers.write_text(drivers.read_text().replace("    baud = 115200\n", patient))
    stop = Tiny.stop_bytes[2:-1]
    stops = {stop, Tiny.jaw_stop[2:-1]}
    rover = TinyRobot(tmp_path / "port")

    def moves() -> bool:
        return rover.speeds == (300, 0) and rover.jaw == 5

    try:
        robot = f"rome={tmp_path / 'robots' / 'rover'}"
        served = machine.start("serve", "all", "--robot", robot, "--port", rover.port)
        until(lambda: machine.pid("DServer") or served.ended(), "the robot runs")
        run = machine.start("drive", str(tmp_path / "cruise.colony"), "--robot", robot)
        until(lambda: moves() or served.ended() or run.ended(), "the robot drives and grasps")
        assert not served.ended(), served.err
        assert not run.ended(), run.err
        os.kill(machine.pid("RServer"), signal.SIGKILL)
        before = len(rover.heard)
        until(lambda: stops <= {data for data, _ in rover.heard[before:]}, "base and gripper stand")
        until(lambda: moves() or served.ended(), "new servers drive it again")
        guard = guard_pid(rover)
        os.kill(guard, signal.SIGSTOP)
        until(lambda: guard_runs(rover) and guard_pid(rover) != guard, "a frozen guard has a successor")
        until(lambda: moves() or served.ended(), "it drives again")
        rover.pull_out()
        stopped = machine.start("stop", "--robot", "rome")
        assert stopped.wait() == 1
        for server in ("RServer", "Gripper"):
            assert f"{server} is stopped, but the stop has not reached its device: " in stopped.err
        rover.plug_in()
        until(lambda: rover.speeds == (0, 0) and rover.jaw == 0, "the guard stops base and gripper")
        until(lambda: machine.start("stop", "--robot", "rome").wait() == 0, "a stop is acknowledged again")
        assert machine.start("stop", "--robot", "rome", "--release").wait() == 0
        until(lambda: moves() or served.ended(), "it drives again")
        assert "nothing stops `RServer`" in served.err
        assert run.interrupt() == 130
        assert served.interrupt() == 0
        until(lambda: rover.heard[-1][0][0] == GOODBYE, "the guard says goodbye")
        assert [data for data, _ in rover.heard if data[0] == SPEEDS][-1] == stop
    finally:
        until(lambda: not guard_runs(rover), "the guard ends after its drivers")
        rover.close()


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ("all --robot rome --port /dev/ttyUSB0", "the body of `rome` names no driver"),
        ("all --robot rover --hardware --baud 9600", "--baud requires --port"),
        ("PServer --robot rover --port /dev/ttyUSB0", "`rover` has no server `PServer`"),
    ],
)
def test_options_that_do_not_fit(
    colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: str, text: str
) -> None:
    monkeypatch.chdir(tmp_path)
    write_files("drivers.md", tmp_path)
    assert text in " ".join(colony.refusal("serve", *options.split()).split())


def test_ports_that_differ(colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_files("drivers.md", tmp_path)
    body = tmp_path / "robots" / "rover" / "rover.toml"
    battery = 'battery", port = "/dev/ttyUSB'
    body.write_text(body.read_text().replace(f"{battery}0", f"{battery}1"))
    err = colony.refusal("serve", "all", "--robot", "rover", "--port", "/dev/ttyUSB7")
    text = "has the ports /dev/ttyUSB0, /dev/ttyUSB1: write there which driver has which"
    assert text in " ".join(err.split())


# --- `colony serve all --robot create2 --port` ---


LEFT_SAFE_MODE = "left safe mode (a wheel hangs)"


@pytest.mark.long
def test_bounce_drives_until_the_robot_is_lifted(machine: Machine) -> None:
    robot = Create2Firmware(EmulatedWorld(range=room(3000.0, 2000.0)))
    with closing(Emulator(robot, baud=115_200)) as emulator:
        emulator.start()
        served = machine.start("serve", "all", "--robot", "create2", "--port", emulator.port)
        until(lambda: robot.mode == OiMode.SAFE or failed(served), "the robot is ready")
        bounce = str(ROOT / "behaviors" / "bounce.colony")
        run = machine.start("drive", bounce, "--robot", "create2", "--record", "run.mcap")
        until(lambda: robot.pose[0] > 300.0 or failed(served, run), "bounce drives")
        robot.drops = (True, True)
        until(lambda: robot.wheels == (0.0, 0.0), "it stands")
        until(lambda: LEFT_SAFE_MODE in served.err or failed(served, run), "the driver reports it")
        assert run.interrupt() == 130
        assert audited(machine, run)
        assert served.interrupt() == 0
    assert LEFT_SAFE_MODE in served.err
    assert "nothing stops `RServer` when its computer fails" in served.err
