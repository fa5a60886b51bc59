"""The devices of a described robot, as its processes serve them: simulated by the plant, or real."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from colony.body.devices import Base, Camera, CeilingCamera, Proximity
from colony.body.model import Body, Server
from colony.body.servers import in_declared_units, in_ros_units
from colony.ir.program import DEFAULT_FRAME_NS
from colony.ir.servers import COMMON_SERVERS, PROXIMITY, RSERVER, ServerSpec
from colony.robots.described import DescribedRobot
from colony.robots.ros2_devices import ros2_hardware
from colony.runtime.assembly.processes.jobs import RobotDevices
from colony.runtime.assembly.processes.spec import PORT, Hardware
from colony.runtime.servers.drivers import BaseLimits


def simulated_devices(robot: DescribedRobot) -> RobotDevices:
    """Return the devices of a robot in the plant: all but its cameras, which are added by name."""
    body = robot.body
    rings = [s.simulated for s in body.servers.values() if isinstance(s.simulated, Proximity)]
    others = {name for name, server in body.servers.items() if not _is_special(server)}
    is_base_simulated = any(isinstance(server.simulated, Base) for server in body.servers.values())
    return RobotDevices(
        base=_limits(body) if is_base_simulated else None,
        sonars=rings[0].count if rings else None,
        servers=tuple(spec for spec in robot.servers if spec.name in others),
    )


def real_devices(robot: DescribedRobot) -> RobotDevices:
    """Return the devices of a robot that have drivers; a ring with one is a device like others."""
    body = robot.body
    hardware = {
        name: _hardware(robot, name, server)
        for name, server in body.servers.items()
        if server.is_real and not isinstance(server.simulated, Camera | CeilingCamera)
    }
    bases = {name for name in hardware if isinstance(body.device(name), Base)}
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
    return tuple(name for name, s in servers if not isinstance(s.simulated, Camera | CeilingCamera))


def _is_special(server: Server) -> bool:
    """Return True for a server that has a class of its own: of a base, a ring or a camera."""
    return isinstance(server.simulated, Base | Proximity | Camera | CeilingCamera)


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


def _hardware(robot: DescribedRobot, name: str, server: Server) -> Hardware:
    """Return the driver of a server, whose module is searched beside the body and in the current folder."""
    if server.hardware is None:
        return ros2_hardware(name, robot.body, robot.interface)
    folders = [] if robot.path is None else [str(Path(robot.path).resolve().parent)]
    where = "" if robot.path is None else f"{robot.path}: "
    return Hardware(
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
