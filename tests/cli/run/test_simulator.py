"""The true way of a simulated robot, as a run sees it: counted by the plant, whatever happens to that."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from colony.body.model import FieldTable, HardwareTable
from colony.body.servers import servers_of
from colony.body.shipped import shipped_body
from colony.cli.run.simulator import TruthLog, is_simulator_starting, simulated_operator
from colony.cli.serve.processes import SERVED, SUPERVISOR, ServeSpec, plant_spec
from colony.ir.program import Robot, Sensor
from colony.ir.types import BOOL
from colony.nav.shared import ELEVATOR_CALL
from colony.runs.described import DescribedRobot
from colony.runtime.assembly.processes.spec import decoded_server
from colony.runtime.kit.script import ScriptError
from colony.runtime.observe.summary import Travel
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.live.run_directory import RobotDirectory
from colony.sim.plant.child import SIMULATOR, plant_socket
from colony.sim.plant.control import PlantControl
from colony.sim.plant.protocol import AttachBase, Attached, BaseReading, DriveBase, pack
from colony.sim.world_spec import WorldSpec
from tests.kit.script_stage import RobotStage
from tests.nav.floors import two_floors
from tests.sim.plant.plants import PlantProcess, wait_for
from tests.sim.plant.test_process import START, Line, is_frozen, standing


@pytest.fixture
def robot_address(tmp_path: Path) -> Local:
    folder = tmp_path / "rome"
    folder.mkdir(mode=0o700)
    return Local(RobotDirectory(folder, "rome"))


@pytest.fixture
def plant(robot_address: Local) -> Iterator[PlantProcess]:
    path = plant_socket(robot_address.directory.path)
    with PlantProcess(path, {"rome": START}) as running:
        yield running


def drive(plant: PlantProcess, way_mm: float) -> Travel:
    """Drive so far or a little farther, and stop; return the travel then."""
    with PlantControl(plant.path) as control:
        end_mm = control.truth("rome").distance + way_mm
        line = Line(plant.path, pack(AttachBase(robot="rome")))
        assert isinstance(line.hear(), Attached)
        while control.truth("rome").distance < end_mm:
            line.sock.send(pack(DriveBase(velocity=500.0, turn=0.0)))
            assert isinstance(line.hear(), BaseReading)
        line.close()
        truth = standing(control, "rome")
    return Travel(bumps=truth.bumps, distance_mm=truth.distance)


def seen(log: TruthLog, travel: Travel) -> None:
    """Poll until the log has got this far: it asks not too often."""
    wait_for(lambda: log.poll() and log.travel == travel)


def test_the_way_of_a_plant_that_was_frozen_is_counted_once(
    robot_address: Local, plant: PlantProcess
) -> None:
    log = TruthLog(robot_address)
    seen(log, drive(plant, 400.0))
    first = log.travel
    plant.process.send_signal(signal.SIGSTOP)
    wait_for(lambda: is_frozen(plant.process.pid))
    wait_for(lambda: not log.poll())  # its answer does not come, and the connection is given up
    assert log.travel == first
    plant.process.send_signal(signal.SIGCONT)
    second = drive(plant, 200.0)
    assert second.distance_mm >= first.distance_mm + 200.0
    seen(log, second)
    log.close()
    assert log.travel == second
    assert log.last.floor == "hallway"
    assert {floor: path[-1] for floor, path in log.paths.items()} == {"hallway": (log.last.x, log.last.y)}


@pytest.mark.long
def test_the_way_of_a_plant_that_died_is_added_to_that_of_the_next(
    robot_address: Local, plant: PlantProcess
) -> None:
    log = TruthLog(robot_address)
    seen(log, drive(plant, 400.0))
    first = log.travel
    plant.kill()
    wait_for(lambda: not log.poll())
    assert log.travel == first
    plant.start_again()
    second = drive(plant, 20.0)
    assert 0.0 < second.distance_mm < first.distance_mm
    both = Travel(bumps=first.bumps + second.bumps, distance_mm=first.distance_mm + second.distance_mm)
    seen(log, both)
    log.close()
    assert log.travel == both


def test_a_plant_that_is_asked_by_another_connection_is_the_same(
    robot_address: Local, plant: PlantProcess
) -> None:
    log = TruthLog(robot_address)
    seen(log, drive(plant, 50.0))
    log.close()
    whole = drive(plant, 50.0)
    seen(log, whole)
    log.close()
    assert log.travel == whole


def test_an_operator_says_that_the_simulator_is_lost(
    robot_address: Local, plant: PlantProcess, tmp_path: Path
) -> None:
    body = shipped_body("rome")
    spec = ServeSpec(described=DescribedRobot(body, servers_of(body)), state=tmp_path)
    with simulated_operator(robot_address, spec, two_floors(tmp_path)) as script:
        stage = RobotStage(operator=script)
        stage.tell(ELEVATOR_CALL, ["liftL", "ground", "upper"])
        plant.kill()
        with pytest.raises(ScriptError, match="`operator` raised RobotConnectionError: lost the simulator: "):
            stage.run(1.0)


@pytest.mark.parametrize("hardware", [True, False])
def test_a_plant_has_the_fields_of_the_interface_and_no_device_that_is_real(
    robot_address: Local, hardware: bool
) -> None:
    body = shipped_body("amr")
    panel = replace(
        body.servers["Panel"], fields={"key": FieldTable()}, hardware=HardwareTable(driver="lab:Panel")
    )
    body = replace(body, servers={**body.servers, "Panel": panel})
    key = Sensor(name="key", type=BOOL, factor=1.0, server="Panel", field="key")
    interface = Robot(name="amr", sensors=(key,))
    spec = ServeSpec(
        described=DescribedRobot(body, servers_of(body, interface)),
        world=WorldSpec(map_path="loop.stickrep", movers=3),
        state=robot_address.directory.path,
        hardware=hardware,
    )
    plant = plant_spec(robot_address, spec)
    servers = {server.name: server for server in map(decoded_server, plant.servers)}
    assert servers.keys() >= {"Lidar", "Lift"}
    assert ("Panel" in servers) is not hardware
    if not hardware:
        assert [field.name for field in servers["Panel"].fields] == ["estop", "key"]
    assert plant.world == spec.world.changed(map_path=os.path.abspath("loop.stickrep"))


# --- the start -------------------------------------------------------------------------------------


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
