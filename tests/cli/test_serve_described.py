"""A described robot in processes: one server for each device of its body, whatever the devices are."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from colony.runtime.kit.connection import Session
from colony.runtime.kit.description import describe
from tests.cli.conftest import Colony, server_states
from tests.cli.machine import MAP, ROBOT, Machine, Started, failed
from tests.waiting import until

AMR = f"{ROBOT}=amr"
DEVICES = {"RServer", "Lidar", "Floor", "Battery", "Panel", "Lift"}
SERVERS = {"Clock", "DServer", "Runtime"} | DEVICES

LIFTING = """
language 1
import robot
module raise  { when sensing                    do lift(position = lift_place.up) }
module drive_ { when lift_position > 100 mm     do drive(velocity = 100 mm/s, turn = 0 deg/s) }
network {
  lift  = raise
  drive = drive_
}
"""


@pytest.fixture
def lifting(tmp_path: Path) -> Path:
    path = tmp_path / "lifting.colony"
    path.write_text(LIFTING)
    return path


@pytest.fixture
def served(machine: Machine) -> Started:
    started = machine.start("serve", "all", "--robot", AMR, "--map", MAP)
    until(lambda: failed(started) or set(machine.directory.running()) >= SERVERS, "all servers run")
    return started


@pytest.mark.long
def test_a_served_robot_takes_programs_and_stops_with_all_its_actuators(
    machine: Machine, served: Started, colony: Colony, lifting: Path
) -> None:
    expected = dict.fromkeys([*SERVERS, "Simulator", "Supervisor"], "up")
    until(lambda: server_states(colony) == expected, "all of them answer")
    run = machine.start("drive", str(lifting), "--robot", AMR)
    until(machine.moves, "the lift is up and the robot drives")
    with machine.session() as session, session.connect("Lift") as lift:
        assert [command.name for command in lift.do(describe()).commands] == ["move"]
    assert "; acknowledged by Clock, RServer, DServer, Lift; " in colony.output("stop")
    until(machine.stands, "the robot stands")
    assert colony("stop", "--release").code == 0
    until(machine.moves, "the robot drives again")
    for server in ("Lidar", "Lift"):
        _kill(machine, server)
    until(machine.moves, "the robot drives again")
    assert not run.ended(), run.err
    assert run.interrupt() == 130
    assert served.interrupt() == 0
    assert ", Lift, DServer, Limits) was killed by SIGKILL; it is restarted" in served.err


def _kill(machine: Machine, server: str) -> None:
    """Kill a server, and wait for the next one; it may still start again with one that was killed before."""
    until(lambda: machine.pid(server) is not None, f"{server} runs")
    pid = machine.pid(server)
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    until(lambda: machine.pid(server) not in (None, pid), f"{server} runs again")


def test_a_server_that_is_not_there_is_down_and_another_process_may_serve_it(
    machine: Machine, colony: Colony
) -> None:
    started = [machine.serve(name, "--robot", AMR) for name in ("Clock", "DServer", "lift")]
    assert f"Lift of {ROBOT} listens at" in started[2].err
    absent = DEVICES - {"Lift"}
    expected = {**dict.fromkeys(SERVERS, "up"), **dict.fromkeys(absent, "down")}
    until(lambda: server_states(colony) == expected, "the Clock misses the others")
    with Session.open(ROBOT, environment=machine.environment) as session:
        assert "Lift" in session.servers()
    for one in started:
        assert one.interrupt() == 0
