"""The simulated devices of a robot, from its body."""

from __future__ import annotations

from typing import assert_never

from colony.body import devices
from colony.body.model import Body
from colony.ir.servers import ServerSpec
from colony.sim.chance import device_seed
from colony.sim.devices.actuators import Joint, Outputs
from colony.sim.devices.device import MeasuringDevice, SimulatedDevice, faults_of
from colony.sim.devices.ranging import Lidar, RangeFinders
from colony.sim.devices.sensors import (
    Battery,
    Bumper,
    Buttons,
    Cliff,
    Compass,
    DockSensor,
    Encoders,
    Imu,
    PaintedValues,
    Unsimulated,
)
from colony.sim.mechanism import Given, Mechanism
from colony.sim.physics import Physics

_Sensing = (
    devices.RangeFinder
    | devices.BumperSpec
    | devices.ImuSpec
    | devices.CompassSpec
    | devices.EncodersSpec
    | devices.CliffSpec
    | devices.DockSensorSpec
    | devices.ValuesSpec
)
"""The devices that take no commands and measure something of the world."""


def devices_of(
    body: Body, servers: tuple[ServerSpec, ...], world: Physics, robot: int, *, seed: int, given: Given
) -> dict[str, SimulatedDevice]:
    """Return the devices of a robot in a world, by the names of their servers.

    Base, ring of sonars and cameras are no part of it. A server whose device exists in hardware alone has a
    device without values.

    Args:
        body: the robot's body.
        servers: what its servers offer.
        world: the world, where the robot has this body; it has reached the beginning of the run.
        robot: the number of the robot.
        seed: seed of the devices' noise, which is independent for each robot and device.
        given: what fields read in place of what is measured.
    """
    found: dict[str, SimulatedDevice] = {}
    for spec in servers:
        server = body.servers.get(spec.name)
        if server is None:
            continue
        own_seed = device_seed(seed, robot, spec.name)
        mechanism = None
        if server.simulated is not None:
            mechanism = world.own_mechanism(spec, server.simulated, robot, own_seed)
        if mechanism is None:
            mechanism = _mechanism(spec, body.device(spec.name), world, robot, own_seed)
        if mechanism is not None:
            periods_ns = {field.name: server.period_ns(field.name) for field in spec.fields}
            faults = faults_of(server.faults, own_seed)
            found[spec.name] = MeasuringDevice(
                spec.name, mechanism, periods_ns, world, robot, given, faults=faults
            )
    return found


def _mechanism(
    spec: ServerSpec, device: devices.Device | None, world: Physics, robot: int, seed: int
) -> Mechanism | None:
    match device:
        case None:
            return Unsimulated()
        case devices.LidarSpec() as lidar:
            blocked = next((field.blocked for field in spec.fields if field.name == lidar.field), ())
            return Lidar(lidar, world, robot, blocked=blocked, seed=seed)
        case devices.BatterySpec() as battery:
            return Battery(battery, world, robot)
        case devices.Button() as button:
            return Buttons(button)
        case devices.JointSpec() | devices.RotaryJoint() as joint:
            return Joint(joint, world)
        case devices.Output() as output:
            return Outputs(output)
        case devices.BaseSpec() | devices.Proximity() | devices.CameraSpec() | devices.CeilingCameraSpec():
            return None
        case _:
            return _sensor(device, world, robot, seed)


def _sensor(sensor: _Sensing, world: Physics, robot: int, seed: int) -> Mechanism:
    match sensor:
        case devices.RangeFinder() as finder:
            return RangeFinders(finder, world, robot, seed=seed)
        case devices.BumperSpec() as bumper:
            return Bumper(bumper, world, robot)
        case devices.ImuSpec() as imu:
            return Imu(imu, world, robot, seed=seed)
        case devices.CompassSpec() as compass:
            return Compass(compass, world, robot, seed=seed)
        case devices.EncodersSpec() as encoders:
            return Encoders(encoders, world, robot)
        case devices.CliffSpec() as cliff:
            return Cliff(cliff, world, robot)
        case devices.DockSensorSpec() as dock_sensor:
            return DockSensor(dock_sensor, world, robot, seed=seed)
        case devices.ValuesSpec() as values:
            return PaintedValues(values, world, robot, seed=seed)
        case _:
            assert_never(sensor)
