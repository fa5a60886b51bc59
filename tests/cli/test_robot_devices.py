"""The devices that processes serve of a described robot: simulated, real, or both."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.cli.serve.processes import (
    ServeSpec,
    mixed_devices,
    ports,
    real_devices,
    simulated_devices,
    with_port,
)
from colony.dsl.load import load_file
from colony.ir.servers import RSERVER, ServerSpec
from colony.runs.described import DescribedRobot, described_robot
from colony.runtime.assembly.processes.jobs import RobotDevices, server_parts, server_processes
from colony.runtime.assembly.processes.spec import (
    Device,
    DevicePart,
    GroupPart,
    HardwareDriver,
    RServerPart,
    name_of,
    read_spec,
)
from colony.runtime.servers.drivers import BaseLimits
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.live.run_directory import RobotDirectory
from colony.sim.world_spec import WorldSpec
from tests.body.test_disagreements import BASE, BODY, INTERFACE

DRIVEN = 'hardware = { driver = "my.base:Base" }\n'
PLANT = Device(plant="")


def described(folder: Path, base: str) -> DescribedRobot:
    """A robot whose base has these keys."""
    (folder / "small.toml").write_text(BODY.replace(BASE, f"[server.RServer]\n{base}"))
    (folder / "small.colony").write_text(INTERFACE)
    return described_robot(load_file(folder / "small.colony").robot)


def rserver(folder: Path, devices: RobotDevices) -> RServerPart | DevicePart:
    """The one part that is `RServer`."""
    parts = server_parts(folder, PLANT, devices)
    [found] = [
        part
        for part in parts
        if isinstance(part, RServerPart)
        or (isinstance(part, DevicePart) and part.server.name == RSERVER.name)
    ]
    return found


@pytest.mark.parametrize("base", [DRIVEN, f'simulated = {{ device = "base" }}\n{DRIVEN}'])
def test_a_driver_of_rserver_drives_a_base_whether_or_not_it_is_simulated(tmp_path: Path, base: str) -> None:
    robot = described(tmp_path, base)
    for devices in (real_devices(robot), mixed_devices(robot)):
        found = rserver(tmp_path, devices)
        assert isinstance(found, RServerPart)
        assert found.device == devices.hardware[RSERVER.name]
        assert found.limits.velocity == robot.body.chassis.limits.velocity_mm_s


def test_a_port_is_given_to_the_drivers_that_have_one(tmp_path: Path) -> None:
    devices = real_devices(described(tmp_path, DRIVEN.replace('Base"', 'Base", port = "/dev/x"')))
    assert ports(devices) == ("/dev/ttyUSB1", "/dev/x")
    options = with_port(devices, "/dev/y", 9600).hardware[RSERVER.name].options
    assert options == {"port": "/dev/y", "baud": 9600}
    for map_path in (None, "loop"):
        world = WorldSpec(map_path=map_path)
        spec = ServeSpec(
            described=described(tmp_path, DRIVEN.replace('Base"', 'Base", port = "/dev/x"')),
            world=world,
            state=tmp_path,
            hardware=True,
            port="/dev/y",
        )
        assert spec.devices.hardware[RSERVER.name].options == {"port": "/dev/y"}
    without = real_devices(described(tmp_path, DRIVEN))
    assert ports(without) == ("/dev/ttyUSB1",)
    assert with_port(without, "/dev/y", None).hardware[RSERVER.name].options == {}


def test_a_base_with_a_driver_alone_is_simulated_as_its_drive_is_described(tmp_path: Path) -> None:
    robot = described(tmp_path, DRIVEN)
    found = rserver(tmp_path, simulated_devices(robot))
    assert isinstance(found, RServerPart)
    assert found.device == PLANT
    assert found.limits.velocity == robot.body.chassis.limits.velocity_mm_s


def test_the_servers_of_one_line_or_of_a_named_process_share_it(tmp_path: Path) -> None:
    def hardware(module: str, process: str | None = None, **options: str) -> HardwareDriver:
        return HardwareDriver(driver=f"{module}:make", process=process, options=dict(options))

    drivers = {
        "RServer": hardware("rover", port="/dev/a"),
        "Battery": hardware("rover", port="/dev/a"),
        "Arm": hardware("rover", port="/dev/b"),
        "Lidar": hardware("lidar", port="/dev/a"),
        "Imu": hardware("rover"),
        "Gps": hardware("rover", process="slow"),
        "Gas": hardware("sniffer", port="/dev/a", process="slow"),
    }
    limits = BaseLimits(velocity=1.0, turn=1.0, acceleration=1.0, turn_acceleration=1.0)
    servers = tuple(ServerSpec(name) for name in drivers if name != "RServer")
    parts = server_parts(tmp_path, PLANT, RobotDevices(base=limits, servers=servers, hardware=drivers))
    address = Local(RobotDirectory(tmp_path, "ada"))
    jobs = server_processes(address, parts, tmp_path, simulator="plant", layout="composed").jobs
    assert [(job.name, *job.others) for job in jobs] == [
        ("Clock", "DServer"),
        ("RServer", "Battery"),
        ("Arm",),
        ("Lidar",),
        ("Imu",),
        ("Gps", "Gas"),
    ]
    assert [(job.essential, job.gives_up) for job in jobs[1:]] == [(False, False)] * 5
    spec = read_spec(Path(jobs[1].arguments[0]))
    assert isinstance(spec.part, GroupPart)
    assert list(map(name_of, spec.part.parts)) == ["RServer", "Battery"]
