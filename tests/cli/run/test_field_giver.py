"""What a scenario gives to the devices in a plant: real sockets, and a plant that is killed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from colony.cli.run.simulator import FieldGiver
from colony.ir.program import Sensor
from colony.ir.types import BOOL
from colony.runs.scenario import ReadingChange
from colony.runs.spec import RunAbortedError
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.live.run_directory import RobotDirectory
from colony.sim.plant.child import plant_socket
from colony.sim.plant.control import PlantControl
from colony.sim.plant.servers import RemoteDevice
from tests.sim.plant.plants import START, PlantProcess, wait_for

S = 1_000_000_000
ESTOP = Sensor(name="estop", type=BOOL, factor=1.0, server="Panel", field="estop")
PRESSED_THEN_RELEASED = (ReadingChange(0, ESTOP, True), ReadingChange(3600 * S, ESTOP, False))


@pytest.fixture
def address(tmp_path: Path) -> Local:
    directory = RobotDirectory(tmp_path / "amr", "amr")
    directory.prepare()
    return Local(directory=directory)


@pytest.fixture
def plant(address: Local) -> Iterator[PlantProcess]:
    with PlantProcess(plant_socket(address.directory.path), {"amr": START}, body="amr") as running:
        yield running


@pytest.mark.long
def test_what_is_given_at_0_holds_until_the_run_has_begun_and_times_count_from_there(
    address: Local, plant: PlantProcess
) -> None:
    begin_ns: list[int] = []
    giver = FieldGiver(address, PRESSED_THEN_RELEASED, lambda: begin_ns[0] if begin_ns else None)
    with closing(giver), closing(RemoteDevice(plant.path, "amr", "Panel")) as panel:

        def reads(pressed: bool) -> bool:
            assert giver.poll()
            reading = panel.fields().get("estop")
            return reading is not None and reading.value is pressed

        wait_for(lambda: reads(True))
        with PlantControl(plant.path) as control:  # the robot's time, an hour ago
            begin_ns.append(control.truth("amr").t_ns - address.directory.origin_ns() - 3600 * S)
        wait_for(lambda: reads(False))
        plant.kill()
        wait_for(lambda: not giver.poll())
        begin_ns[0] += 3600 * S
        plant.start_again()
        wait_for(giver.poll)
        wait_for(lambda: reads(True))
        giver.close()
        wait_for(lambda: (reading := panel.fields().get("estop")) is not None and reading.value is False)


def test_what_the_plant_refuses_ends_the_run(address: Local, plant: PlantProcess) -> None:
    stop = Sensor(name="stop", type=BOOL, factor=1.0, server="Panel", field="stop")
    with closing(FieldGiver(address, (ReadingChange(0, stop, True),), lambda: None)) as giver:
        expected = "`stop` cannot be given: Panel has no field `stop`; it has estop"
        with pytest.raises(RunAbortedError, match=expected):
            giver.poll()


def test_without_a_plant_nothing_is_given_yet(address: Local) -> None:
    with closing(FieldGiver(address, PRESSED_THEN_RELEASED, lambda: None)) as giver:
        assert not giver.poll()
    with closing(FieldGiver(address, (), lambda: None)) as giver:
        assert giver.poll()
