"""Whether the simulator of a robot is being started, by what `serve all` leaves in the robot's folder."""

from __future__ import annotations

import socket
from pathlib import Path

from colony.robots.simulated import SERVED, SUPERVISOR, is_simulator_starting
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.live.run_directory import RobotDirectory
from colony.sim.plant.child import SIMULATOR, plant_socket


def test_a_simulator_starts_from_the_claim_of_its_supervisor_until_it_takes_drivers(tmp_path: Path) -> None:
    directory = RobotDirectory(tmp_path / "r", "rome")
    directory.prepare()
    robot, served = Local(directory), directory.path / SERVED
    served.mkdir()
    assert not is_simulator_starting(robot)
    with directory.claim(SUPERVISOR):
        assert is_simulator_starting(robot)  # the specs are not written yet
        (served / "Clock.json").touch()
        assert not is_simulator_starting(robot)  # all devices are real
        (served / f"{SIMULATOR}.json").touch()
        assert is_simulator_starting(robot)
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as plant:
            plant.bind(str(plant_socket(directory.path)))
            assert is_simulator_starting(robot)  # the socket of one that was killed
    with directory.claim(SIMULATOR):
        assert is_simulator_starting(robot)  # by `serve Simulator`


def test_a_simulator_that_is_frozen_is_not_starting(tmp_path: Path) -> None:
    directory = RobotDirectory(tmp_path / "r", "rome")
    directory.prepare()
    with directory.claim(SIMULATOR), socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as plant:
        plant.bind(str(plant_socket(directory.path)))
        plant.listen()
        assert not is_simulator_starting(Local(directory))
