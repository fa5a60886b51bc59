"""`colony serve --hardware`: real devices by drivers of users, which end nothing but themselves."""

from __future__ import annotations

import os
import re
import sys
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from tests.cli.conftest import Colony, server_states
from tests.cli.machine import ROBOT, Machine, failed
from tests.pages import files
from tests.waiting import until

# --- the robot of docs/robots.md -------------------------------------------------------------------------

BASE = '''
import time
from colony.runtime.servers.drivers import BaseState

class Motors:
    """A base that writes what it is told into a file, a command a line."""

    def __init__(self, file):
        self.file = open(file, "a", buffering=1)

    def drive(self, velocity, turn):
        print(f"{velocity:g}", file=self.file)

    def stop(self):
        print("stop", file=self.file)

    def state(self):
        still = dict(x=0.0, y=0.0, heading=0.0, speed=0.0, turn_rate=0.0, wheel_speed=0.0)
        return BaseState(t_ns=time.monotonic_ns(), front_bumper=False, rear_bumper=False, **still)
'''


class Scanner:
    """The far end of the scanner's line, which sends scans while it is on. Mutable."""

    def __init__(self) -> None:
        self._far, self.near = os.openpty()
        tty.setraw(self.near)
        os.set_blocking(self._far, False)
        self.port = os.ttyname(self.near)
        self.on = True
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._send)
        self._thread.start()

    def _send(self) -> None:
        scan = b" ".join([b"0", *[b"900"] * 540]) + b"\n"
        while not self._ended.wait(0.03):
            if self.on:
                with suppress(BlockingIOError):
                    os.write(self._far, scan)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        os.close(self._far)
        os.close(self.near)


@contextmanager
def scanner() -> Iterator[Scanner]:
    made = Scanner()
    try:
        yield made
    finally:
        made.close()


def _commands(file: Path) -> list[str]:
    return file.read_text().split() if file.exists() else []


def test_the_scout_of_the_page_drives_by_its_drivers_and_stands_when_its_scanner_is_silent(
    machine: Machine, tmp_path: Path
) -> None:
    commands = tmp_path / "commands"
    with scanner() as lidar:
        shown = files("robots.md")
        shown["robots/scout/scout_drivers.py"] += BASE
        body = shown["robots/scout/scout.toml"].replace("/dev/ttyUSB0", lidar.port)
        hardware = f'hardware = {{ driver = "scout_drivers:Motors", file = "{commands}" }}'
        shown["robots/scout/scout.toml"] = body.replace("[server.RServer]", f"[server.RServer]\n{hardware}")
        for name, text in shown.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(text)
        robot = f"{ROBOT}={tmp_path / 'robots' / 'scout'}"
        served = machine.start("serve", "all", "--robot", robot, "--hardware")
        until(lambda: machine.pid("DServer") or failed(served), "the robot runs")
        run = machine.start("drive", str(tmp_path / "patrol.colony"), "--robot", robot)
        until(lambda: "300" in _commands(commands)[-1:] or failed(served, run), "the robot drives")
        lidar.on = False
        until(lambda: _commands(commands)[-1] != "300", "it stands")
        lidar.on = True
        until(lambda: "300" in _commands(commands)[-1:] or failed(served, run), "it drives again")
        assert run.interrupt() == 130
        assert served.interrupt() == 0
        assert _commands(commands)[-1] == "stop"
    assert f"{ROBOT}: Clock, DServer, Limits, RServer, Lidar; Ctrl-C ends them" in served.err


# --- drivers that fail -----------------------------------------------------------------------------------

LAB = """
language 1
robot lab {
  sensor   good : number      from Good.value      within 300 ms
  sensor   raising : number   from Raising.value   within 300 ms
  sensor   garbage : number   from Garbage.value   within 300 ms
  sensor   blocking : number  from Blocking.value  within 300 ms
  sensor   late : number      from Late.value      within 300 ms
  sensor   broken : number    from Broken.value    within 300 ms
  sensor   absent : number    from Absent.value    within 300 ms
  actuator light { on : bool } to Good.set  idle light(on = false)
}
"""
LIGHTING = """
language 1
import robot
module shine {
  when good == 1 and not fresh(raising) and not fresh(garbage) and not fresh(blocking)
       and not fresh(broken) and not fresh(absent)
  do light(on = true)
}
network { light = shine }
"""
DRIVERS = """
import os
import threading
from colony.runtime.kit.server import Reading

class Driver:
    def __init__(self, **options):
        self.__dict__.update(options)
    def fields(self):
        return {"value": Reading(1, 0)}
    def command(self, name, values):
        raise RuntimeError("no command")
    def safe(self): pass
    def close(self): pass

class Good(Driver):
    def command(self, name, values):
        open(self.file, "a").write(f"{values['on']} ")

class Raising(Driver):
    def fields(self):
        if not os.path.exists(self.file):
            raise RuntimeError("no bus")
        return {"value": Reading(1, 0)}

class Garbage(Driver):
    def fields(self):
        return {"value": Reading("one", -1), 7: 8}

class Blocking(Driver):
    def fields(self):
        threading.Event().wait()

class Late(Driver):
    def __init__(self, file):
        open(file).close()
"""


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """The folder of a robot all of whose drivers but one fail."""
    folder = tmp_path / "lab"
    folder.mkdir()
    body = [
        *("[robot]", 'name = "lab"'),
        *("[body]", 'footprint = { shape = "circle", radius = "300 mm" }'),
        *("[body.drive]", 'kind = "differential"', 'wheel_base = "300 mm"'),
        *("[body.limits]", 'velocity = "1 m/s"', 'turn = "90 deg/s"'),
        *('acceleration = "1 m/s^2"', 'turn_acceleration = "90 deg/s^2"'),
    ]
    for server in ("Good", "Raising", "Garbage", "Blocking", "Late", "Broken"):
        module = "no_drivers" if server == "Broken" else "lab_drivers"
        file = f'file = "{tmp_path / server}"'
        body += [f"[server.{server}]", "fields.value = {}"]
        body.append(f'hardware = {{ driver = "{module}:{server}", {file} }}')
    body += ["[server.Absent]", "simulated = { device = 'button', fields = ['value'] }", "fields.value = {}"]
    (folder / "lab.toml").write_text("\n".join(body))
    (folder / "lab.colony").write_text(LAB.replace("absent : number", "absent : bool"))
    (folder / "lab_drivers.py").write_text(DRIVERS)
    (tmp_path / "lighting.colony").write_text(LIGHTING)
    return folder


@pytest.mark.long
def test_drivers_that_fail_end_no_other_server(
    machine: Machine, colony: Colony, lab: Path, tmp_path: Path
) -> None:
    robot = f"{ROBOT}={lab}"
    served = machine.start("serve", "all", "--robot", robot, "--hardware")
    until(lambda: machine.pid("DServer") or failed(served), "the robot runs")
    run = machine.start("drive", str(tmp_path / "lighting.colony"), "--robot", robot)
    until(lambda: "True" in _commands(tmp_path / "Good") or failed(served, run), "the light shines")
    line = DRIVERS.splitlines().index("        open(file).close()") + 1
    late = f"{lab}/lab_drivers.py:{line}: FileNotFoundError"
    until(lambda: late in served.err or failed(served), "the late driver is tried again")
    assert "Late: " in served.err
    assert "; it is tried again until it works" in served.err
    broken = "the driver `no_drivers:Broken` cannot be imported: ModuleNotFoundError"
    assert f"Broken: {lab}/lab.toml: server.Broken.hardware: {broken}" in served.err
    assert "Absent: no driver: nothing serves it but a server of your own" in served.err
    (tmp_path / "Late").touch()
    until(lambda: machine.pid("Late") or failed(served), "the late driver works")
    expected = {
        **dict.fromkeys(("Clock", "DServer", "Runtime", "Good", "Raising", "Garbage", "Late"), "up"),
        **dict.fromkeys(("Broken", "Absent"), "down"),
        **dict.fromkeys(("Leader", "Supervisor"), "up"),
        "Blocking": "silent",
    }
    until(lambda: server_states(colony) == expected or failed(served), "all answer but the one that blocks")
    failure = "fields of Raising failed: RuntimeError: no bus"
    assert re.search(rf"Raising +up, process \d+, FAILS: {failure}", colony("ps").out)
    until(lambda: f"\nRaising fails: {failure}\n" in served.err, "one line")
    (tmp_path / "Raising").touch()
    until(lambda: "\nRaising works again\n" in served.err or failed(served), "it works again")
    assert served.err.count("Raising fails") == 1
    folder = machine.directory.path / "served"
    assert "RuntimeError: no bus" in (folder / "Raising.log").read_text()
    assert (
        "Garbage.value has an age of -1 ns: a reading from the future" in (folder / "Garbage.log").read_text()
    )
    assert not run.ended()
    for one in (run, served):
        one.interrupt()
    assert f"\n  Raising failed: {failure}\n" in run.out
    assert "\n  Good failed" not in run.out
    assert _commands(tmp_path / "Good")[-1] == "False"


@pytest.mark.parametrize(
    ("server", "code", "reason"),
    [
        ("Late", 1, "cannot be made"),
        ("Broken", 1, "cannot be imported"),
        ("Absent", 2, "--hardware: the body names no driver for Absent"),
    ],
)
@pytest.mark.usefixtures("machine")
def test_one_server_with_its_driver_says_what_is_wrong(
    colony: Colony, lab: Path, monkeypatch: pytest.MonkeyPatch, server: str, code: int, reason: str
) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    ran = colony("serve", server, "--robot", f"{ROBOT}={lab}", "--hardware")
    assert ran.code == code
    assert reason in ran.err
