"""The devices of a described robot in the plant: real sockets, and drivers that come and go."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from colony.body.shipped import shipped_body
from colony.nav.maps.world_map import load_world
from colony.runtime.servers.drivers import Reading
from colony.sim.plant.assembly import PlantOptions, assembled_devices
from colony.sim.plant.control import PlantControl
from colony.sim.plant.protocol import (
    AttachDevice,
    Attached,
    AttachProximity,
    DeviceCommand,
    DeviceReading,
    DriveBase,
    FieldReading,
    Give,
    MakeSafe,
    pack,
)
from colony.sim.plant.servers import MAX_READING_AGE_NS, RemoteDevice
from tests.paths import MAPS
from tests.sim.plant.plants import START, PlantProcess, wait_for
from tests.sim.plant.test_process import Line

LIFT = pack(AttachDevice(robot="amr", server="Lift"))
UP, DOWN = 2.0, 0.0
MS = 1_000_000


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlantProcess]:
    path = tmp_path_factory.mktemp("plant") / "plant"
    with PlantProcess(path, {"amr": START}, body="amr") as running:
        yield running
        assert running.end() == 0


def found(driver: RemoteDevice, field: str) -> Reading | None:
    return driver.fields().get(field)


def value(driver: RemoteDevice, field: str) -> object:
    reading = found(driver, field)
    return None if reading is None else reading.value


def test_each_device_has_its_fields_with_their_ages(plant: PlantProcess) -> None:
    fields = {
        "Lidar": {"scan"},
        "Floor": {"cliff"},
        "Battery": {"level", "charging"},
        "Panel": {"estop"},
        "Lift": {"position", "target", "moving", "load", "lower_end", "upper_end"},
    }
    for server, names in fields.items():
        with closing(RemoteDevice(plant.path, "amr", server)) as driver:
            assert wait_for(driver.fields).keys() == names
            assert driver.problem is None
            scan = found(driver, "scan")
            if scan is not None:
                assert isinstance(scan.value, tuple)
                assert len(scan.value) == 360
                assert 0 <= scan.age_ns < MAX_READING_AGE_NS


def test_a_lift_goes_where_it_is_sent_and_stops_when_its_driver_is_gone(plant: PlantProcess) -> None:
    with closing(RemoteDevice(plant.path, "amr", "Lift")) as lift:
        wait_for(lambda: value(lift, "moving") is False)
        lift.command("move", {"position": UP})
        wait_for(lambda: value(lift, "moving") is True)
        assert value(lift, "target") == UP
        lift.safe()
        wait_for(lambda: value(lift, "moving") is False)
        lift.command("move", {"position": UP})
        wait_for(lambda: value(lift, "moving") is True)
        with closing(RemoteDevice(plant.path, "amr", "Lift")) as reader:
            wait_for(reader.fields)
        for _ in range(3):  # a second driver that is gone changes nothing
            assert value(lift, "moving") is True
    with closing(RemoteDevice(plant.path, "amr", "Lift")) as lift:
        wait_for(lambda: value(lift, "moving") is False)
        position = value(lift, "position")
        assert isinstance(position, float)
        assert 0.0 < position < 200.0
        lift.command("move", {"position": DOWN})
        wait_for(lambda: value(lift, "position") == 0.0)


def test_a_field_reads_what_is_given_until_the_connection_ends(plant: PlantProcess) -> None:
    with closing(RemoteDevice(plant.path, "amr", "Panel")) as panel:
        wait_for(lambda: value(panel, "estop") is False)
        with PlantControl(plant.path) as control:
            control.give("amr", "Panel", "estop", True)
            wait_for(lambda: value(panel, "estop") is True)
            control.give("amr", "Panel", "estop", "missing")
            wait_for(lambda: panel.fields() == {"estop": None})
            control.give("amr", "Panel", "estop", None)
            wait_for(lambda: value(panel, "estop") is False)
            control.give("amr", "Panel", "estop", True)
            wait_for(lambda: value(panel, "estop") is True)
        wait_for(lambda: value(panel, "estop") is False)


def test_a_field_reads_what_is_given_from_its_time_on(tmp_path: Path) -> None:
    step, scan = 50 * MS, tuple(float(i) for i in range(360))
    amr = PlantOptions(
        path=tmp_path / "plant",
        world=load_world(MAPS / "hallway.stickrep"),
        robots={"amr": START},
        body=shipped_body("amr"),
        step_ns=step,
    )
    devices = assembled_devices(amr, lambda: 7)
    for server, name, wanted, steps in (
        ("Panel", "estop", True, 2),
        ("Panel", "estop", False, 3),
        ("Lidar", "scan", scan, 1),
    ):
        devices.give(None, 0, server, name, 7 + steps * step, wanted)

    def read(server: str, name: str) -> object:
        reading = devices.device(0, server)[name]
        assert reading is not None
        return reading.value

    pressed, given = [], []
    for k in range(5):
        devices.advance(7 + k * step)
        pressed.append(read("Panel", "estop"))
        given.append(read("Lidar", "scan") == scan)
    assert pressed == [False, False, True, False, False]
    assert given == [False, True, True, True, True]


NOT_GIVEN = [
    (("rome", "Panel", "estop"), "no robot `rome`; the robots are amr"),
    (("amr", "RServer", "bumper"), "the robot has no device of `RServer`; it has Lidar, Floor"),
    (("amr", "Panel", "stop"), "Panel has no field `stop`; it has estop"),
]


@pytest.mark.parametrize(("place", "problem"), NOT_GIVEN)
def test_what_cannot_be_given_is_refused(
    plant: PlantProcess, place: tuple[str, str, str], problem: str
) -> None:
    with PlantControl(plant.path) as control:
        with pytest.raises(ValueError, match=problem):
            control.give(*place, True)
        assert control.truth("amr").bumps == 0  # the connection goes on


NONSENSE = [
    (
        [pack(AttachDevice(robot="amr", server="Lidr"))],
        "the robot has no device of `Lidr`; it has Lidar, Floor",
    ),
    ([pack(AttachProximity(robot="amr"))], "the robot has no ring of sonars"),
    ([LIFT, pack(DeviceCommand(name="fly", values={}))], "a joint has no command `fly`"),
    ([LIFT, pack(DeviceCommand(name="move", values={"position": float("nan")}))], "expected finite"),
    ([LIFT, pack(DeviceCommand(name="move", values={"position": 7.0}))], "position 7; expected a number"),
    ([LIFT, pack(DriveBase(velocity=1.0, turn=0.0))], "DriveBase is not allowed on this connection"),
    (
        [LIFT, pack(Give(robot="amr", server="Lift", field="load", t_ns=0, value=1.0))],
        "Give is not allowed on this connection",
    ),
    ([pack(MakeSafe())], "MakeSafe is not allowed on this connection"),
]


@pytest.mark.parametrize(("said", "problem"), NONSENSE)
def test_what_makes_no_sense_is_refused(plant: PlantProcess, said: list[bytes], problem: str) -> None:
    assert problem in Line(plant.path, *said).refusal()


def test_without_a_plant_there_is_no_value_and_a_command_fails(tmp_path: Path) -> None:
    path = tmp_path / "plant"
    with closing(RemoteDevice(path, "amr", "Lift")) as lift:
        assert lift.fields() == {}
        assert (lift.problem, lift.is_opening) == (None, True)
        with pytest.raises(ConnectionError, match="the simulator takes no command: it is not connected yet"):
            lift.command("move", {"position": UP})
        lift.safe()
        with PlantProcess(path, {"amr": START}, body="amr") as running:
            wait_for(lift.fields)
            running.kill()
            wait_for(lambda: lift.problem == "the Simulator is not running yet, or no longer")
            assert not lift.is_opening
        wait_for(lambda: lift.fields() == {})  # what it read last is too old


def test_readings_age_apart_from_the_reports_of_the_plant(tmp_path: Path) -> None:
    """A plant that reports in time what it measured long ago, and one that falls silent."""
    path, now = tmp_path / "plant", [time.monotonic_ns()]
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(os.fspath(path))
        listener.listen()
        driver = RemoteDevice(path, "amr", "Lift", clock=lambda: now[0])
        connection, _ = listener.accept()
        fields = {
            "old": FieldReading(1.0, now[0] - 900 * MS),
            "future": FieldReading(2.0, now[0] + 5 * MS),
            "none": None,
        }
        for message in (Attached(began_ns=1), DeviceReading(value=fields, t_ns=now[0])):
            connection.send(pack(message))
        expected = {"old": Reading(1.0, 900 * MS), "future": Reading(2.0, -5 * MS), "none": None}
        assert wait_for(driver.fields) == expected  # its server refuses what is from the future
        now[0] += MAX_READING_AGE_NS
        assert driver.fields()["old"] == Reading(1.0, 1400 * MS)
        now[0] += 1
        assert driver.fields() == {}
        connection.close()
        driver.close()


def test_holes_and_docks_of_the_map_are_those_of_the_plant(tmp_path: Path) -> None:
    x, y, _ = START
    hole = f"hole {(x + 200.0) / 25.4} {(y - 500.0) / 25.4} {(x + 600.0) / 25.4} {(y + 500.0) / 25.4}"
    dock = f"dock {(x + 2000.0) / 25.4} {y / 25.4} 270"
    hallway = (MAPS / "hallway.stickrep").read_text(encoding="utf-8")
    building = tmp_path / "holed.stickrep"
    building.write_text(hallway.replace("\nstart ", f"\n{hole}\n{dock}\nstart ", 1), encoding="utf-8")
    with PlantProcess(tmp_path / "plant", {"amr": START}, body="amr", building=building) as running:
        with (
            closing(RemoteDevice(running.path, "amr", "Floor")) as floor,
            closing(RemoteDevice(running.path, "amr", "Battery")) as battery,
        ):
            wait_for(lambda: value(floor, "cliff") == (True, True, False, False))
            wait_for(lambda: value(battery, "charging") is False)  # the dock is elsewhere
        assert running.end() == 0
