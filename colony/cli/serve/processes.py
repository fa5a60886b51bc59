"""The processes of a robot: its servers, with the devices that each drives, and the simulator."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec

from colony.body.devices import BaseSpec, CameraSpec, CeilingCameraSpec, Proximity
from colony.body.model import Body, ServerTable
from colony.body.servers import in_declared_units, in_ros_units
from colony.execute.compiled import Compiled
from colony.ir.program import DEFAULT_FRAME_NS
from colony.ir.servers import COMMON_SERVERS, PROXIMITY, RSERVER, ServerSpec
from colony.ir.types import Value
from colony.runs.described import DescribedRobot
from colony.runs.ros2_devices import ros2_hardware
from colony.runs.spec import MisuseError
from colony.runtime.assembly.limits import limit_deployment
from colony.runtime.assembly.processes.children import Job
from colony.runtime.assembly.processes.jobs import (
    HARDWARE,
    Layout,
    Processes,
    RobotDevices,
    limits_part,
    server_parts,
    server_processes,
)
from colony.runtime.assembly.processes.spec import (
    PORT,
    Device,
    HardwareDriver,
    Part,
    encoded_server,
    write_spec,
)
from colony.runtime.protocol.interface import Interface
from colony.runtime.servers.drivers import BaseLimits
from colony.runtime.transport.live.robot_address import Local
from colony.sim.config import config_of
from colony.sim.plant.child import SIMULATOR, PlantSpec, plant_socket
from colony.sim.world_spec import WorldSpec

PLANT = "colony.sim.plant.child"
PLANT_SERVERS = "colony.sim.plant.servers"

SUPERVISOR = "Supervisor"
"""The name under which `serve all` claims a robot."""

SERVED = "served"
"""The name of the folder, in that of a robot, with the specs and logs of the processes of `serve all`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeSpec:
    """The specification of a robot's servers.

    Attributes:
        described: the robot.
        world: the world. Without a map, another process simulates it, or all devices are real.
        state: the folder of data that survives a restart of a server.
        fsync: True to make DServer's data survive a power failure.
        pinned_variables: variables of DServer, with the values at which they are kept.
        interface: that of the robot's description, if it has one.
        limits: the limits of that description, compiled, if it has any.
        hardware: True if devices of the robot that have drivers are real; others are simulated in a world
            with a map.
        read_only: True to command nothing, and to hear what another controller commands.
        port, baud: what replaces the port and the baud rate that the body gives to drivers.
        isolate: True to run each server in its own process.
        listen: the endpoint of the gateway; None for no gateway.
        security: the file with the gateway's table of users.
    """

    described: DescribedRobot
    world: WorldSpec = field(default_factory=WorldSpec)
    state: Path
    fsync: bool = False
    pinned_variables: Mapping[str, Value] = field(default_factory=dict)
    interface: Interface | None = None
    limits: Compiled | None = None
    hardware: bool = False
    read_only: bool = False
    port: str | None = None
    baud: int | None = None
    isolate: bool = False
    listen: str | None = None
    security: Path | None = None

    @property
    def devices(self) -> RobotDevices:
        """The devices of the robot."""
        if not self.hardware:
            return simulated_devices(self.described)
        is_mixed = self.world.map_path is not None
        devices = mixed_devices(self.described) if is_mixed else real_devices(self.described)
        if self.read_only:
            hardware = {n: msgspec.structs.replace(d, listens=True) for n, d in devices.hardware.items()}
            return replace(devices, hardware=hardware)
        return devices if self.port is None else with_port(devices, self.port, self.baud)


def plant_spec(robot_address: Local, spec: ServeSpec) -> PlantSpec:
    """Return the spec of the plant, with the servers whose devices are in it.

    Raises:
        MisuseError: the simulator cannot simulate the robot.
    """
    body, path, map_path = spec.described.body, spec.described.path, spec.world.map_path
    assert map_path is not None
    try:
        config_of(body)
    except ValueError as problem:
        raise MisuseError(f"colony: error: `{body.robot.name}` cannot be simulated: {problem}") from None
    real = real_devices(spec.described).hardware if spec.hardware else {}
    simulated = simulated_devices(spec.described).servers  # all but the base, a ring and cameras
    return PlantSpec(
        robot=robot_address.robot,
        folder=str(robot_address.directory.path),
        world=spec.world.changed(map_path=os.path.abspath(map_path)),
        body=None if path is None else os.path.abspath(path),
        servers=tuple(encoded_server(server) for server in simulated if server.name not in real),
    )


def parts_of(robot_address: Local, spec: ServeSpec) -> tuple[Part, ...]:
    """Return the parts of the robot's servers."""
    return server_parts(
        spec.state,
        Device(plant=str(plant_socket(robot_address.directory.path))),
        spec.devices,
        cameras=[(name, name) for name in spec.world.cameras],
        fsync=spec.fsync,
        pinned_variables=dict(spec.pinned_variables),
        interface=spec.interface,
        resident=None if spec.limits is None else limit_deployment(spec.limits),
        read_only=spec.read_only,
    )


def processes_of(robot_address: Local, spec: ServeSpec, folder: Path, *, layout: Layout) -> Processes:
    """Return the robot's processes, the slowest first, and write their specs into `folder`."""
    plant: list[Job] = []
    if spec.world.map_path is not None:
        spec_file = folder / f"{SIMULATOR}.json"
        write_spec(spec_file, plant_spec(robot_address, spec))
        plant.append(
            Job(
                name=SIMULATOR,
                module=PLANT,
                arguments=(str(spec_file),),
                log=spec_file.with_suffix(".log"),
                wave=HARDWARE,
                essential=True,
            )
        )
    parts = parts_of(robot_address, spec)
    if spec.limits is not None:
        parts = (*parts, limits_part(spec.limits, folder))
    servers = server_processes(robot_address, parts, folder, simulator=PLANT_SERVERS, layout=layout)
    return servers._replace(jobs=(*plant, *servers.jobs))


# --- devices -------------------------------------------------------------------------------------

_SPECIAL = BaseSpec | Proximity | CameraSpec | CeilingCameraSpec
"""The devices whose servers have classes of their own."""


def simulated_devices(robot: DescribedRobot) -> RobotDevices:
    """Return the devices of a robot in the plant: all but its cameras, which are added by name."""
    body = robot.body
    rings = [s.simulated for s in body.servers.values() if isinstance(s.simulated, Proximity)]
    others = {name for name in body.servers if not isinstance(body.device(name), _SPECIAL)}
    return RobotDevices(
        base=None if body.base is None else _limits(body),
        sonars=rings[0].count if rings else None,
        servers=tuple(spec for spec in robot.servers if spec.name in others),
    )


def real_devices(robot: DescribedRobot) -> RobotDevices:
    """Return the devices of a robot that have drivers; a ring with one is a device like others."""
    body = robot.body
    hardware = {
        name: _hardware(robot, name, server)
        for name, server in body.servers.items()
        if server.is_real and not isinstance(server.simulated, CameraSpec | CeilingCameraSpec)
    }
    bases = {name for name in hardware if isinstance(body.device(name), BaseSpec)}
    common = {spec.name for spec in COMMON_SERVERS}
    return RobotDevices(
        base=_limits(body) if bases else None,
        servers=tuple(
            _in_units_of_driver(spec, robot) for spec in robot.servers if spec.name in hardware.keys() - bases
        ),
        hardware=hardware,
        absent=tuple(s.name for s in robot.servers if s.name not in hardware and s.name not in common),
    )


def _in_units_of_driver(spec: ServerSpec, robot: DescribedRobot) -> ServerSpec:
    if robot.interface is None:
        return spec
    server = robot.body.servers[spec.name]
    if server.ros2:
        return in_ros_units(spec, server, robot.interface)
    return in_declared_units(spec, robot.interface)


def mixed_devices(robot: DescribedRobot) -> RobotDevices:
    """Return the devices of a robot: real ones as far as they have drivers, and the others in the plant."""
    simulated, real = simulated_devices(robot), real_devices(robot)
    served = {spec.name: spec for spec in (*simulated.servers, *real.servers)}
    if real.base is not None:
        served.pop(RSERVER.name, None)
    return RobotDevices(
        base=real.base or simulated.base,
        sonars=None if PROXIMITY in real.hardware else simulated.sonars,
        servers=tuple(served[spec.name] for spec in robot.servers if spec.name in served),
        hardware=real.hardware,
    )


def served_names(robot: DescribedRobot) -> tuple[str, ...]:
    """Return the servers of a robot's body that can be served without further options: not its cameras."""
    servers = robot.body.servers.items()
    return tuple(name for name, s in servers if not isinstance(s.simulated, CameraSpec | CeilingCameraSpec))


def _limits(body: Body) -> BaseLimits:
    limits = body.chassis.limits
    return BaseLimits(
        velocity=limits.velocity_mm_s,
        turn=limits.turn_deg_s,
        acceleration=limits.acceleration_mm_s2,
        turn_acceleration=limits.turn_acceleration_deg_s2,
        sideways=body.chassis.sideways_mm_s,
        sideways_acceleration=body.chassis.sideways_acceleration_mm_s2,
    )


def _hardware(robot: DescribedRobot, name: str, server: ServerTable) -> HardwareDriver:
    """Return the driver of a server, whose module is searched beside the body and in the current folder."""
    if server.hardware is None:
        return ros2_hardware(name, robot.body, robot.interface)
    folders = [] if robot.path is None else [str(Path(robot.path).resolve().parent)]
    where = "" if robot.path is None else f"{robot.path}: "
    return HardwareDriver(
        driver=server.hardware.driver,
        options=dict(server.hardware.options),
        process=server.hardware.process,
        search_path=tuple(dict.fromkeys([*folders, os.getcwd()])),
        origin=f"{where}server.{name}.hardware",
        frame_ns=DEFAULT_FRAME_NS if robot.interface is None else robot.interface.frame_ns,
    )


def ports(devices: RobotDevices) -> tuple[str, ...]:
    """Return the ports that drivers have by the body, each once."""
    return tuple(dict.fromkeys(str(d.options[PORT]) for d in devices.hardware.values() if PORT in d.options))


def with_port(devices: RobotDevices, port: str, baud: int | None) -> RobotDevices:
    """Return the devices with this port, and baud rate if one is given, for each driver that has a `port`."""
    given: dict[str, str | int | float | bool] = {PORT: port} if baud is None else {PORT: port, "baud": baud}
    hardware = {
        name: driver.with_options(given) if PORT in driver.options else driver
        for name, driver in devices.hardware.items()
    }
    return replace(devices, hardware=hardware)
