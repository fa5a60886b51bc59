"""Scripted devices for any program: sensors on two servers and in DServer, actuators on a base and a server.

What a sensor reads is a function of the time, so that a server that starts anew reads the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace

from colony.ir.frame import Reading as FrameReading
from colony.ir.program import Actuator, Program, Sensor
from colony.ir.servers import DSERVER, RSERVER, CommandSpec, FieldSpec, ParameterSpec, ServerSpec
from colony.ir.types import ScalarValue
from colony.runtime.assembly.processes.jobs import RobotDevices
from colony.runtime.assembly.processes.spec import Device
from colony.runtime.servers.drivers import (
    BaseDriver,
    BaseLimits,
    BaseState,
    CameraDriver,
    DeviceDriver,
    ProximityDriver,
    Reading,
)

LIMITS = BaseLimits(velocity=500.0, turn=90.0, acceleration=1000.0, turn_acceleration=1000.0)
MOTORS = "Motors"
SENSOR_SERVERS = ("Ears", "Eyes", DSERVER.name)

Command = tuple[int, str, str, str]
"""What was sent to a device: the time, its server, the command, and its values as text."""


def on_devices(program: Program) -> Program:
    """Return the program with its sensors and actuators on scripted devices, in turn, and on DServer."""
    actuators = tuple(map(_actuator, program.robot.actuators))
    servers = {actuator.name: actuator.server for actuator in actuators}
    sensors = tuple(
        replace(s, server=servers[s.sent.actuator])
        if s.sent is not None
        else s
        if s.tunable
        else replace(s, server=SENSOR_SERVERS[i % len(SENSOR_SERVERS)], field=s.name)
        for i, s in enumerate(program.robot.sensors)
    )
    return replace(program, robot=replace(program.robot, sensors=sensors, actuators=actuators))


def _actuator(actuator: Actuator) -> Actuator:
    is_base = [field.name for field in actuator.fields] == ["velocity", "turn"]
    if actuator.server == DSERVER.name or is_base:
        return actuator
    return replace(actuator, server=MOTORS, command=actuator.name)


def devices_of(program: Program) -> RobotDevices:
    """Return the devices that the program is bound to."""
    robot = program.robot
    has_base = any(a.server == RSERVER.name for a in robot.actuators)
    commands = tuple(
        CommandSpec(a.command, tuple(ParameterSpec(f.name, f.type, "", factor=f.factor) for f in a.fields))
        for a in robot.actuators
        if a.server == MOTORS
    )
    sensing = (ServerSpec(name, fields=_fields(robot.sensors, name)) for name in SENSOR_SERVERS[:2])
    motors = (ServerSpec(MOTORS, commands=commands),) if commands else ()
    servers = (*(server for server in sensing if server.fields), *motors)
    return RobotDevices(base=LIMITS if has_base else None, servers=servers)


def _fields(sensors: Sequence[Sensor], server: str) -> tuple[FieldSpec, ...]:
    return tuple(FieldSpec(s.field, s.type, "", factor=s.factor) for s in sensors if s.server == server)


class Plant:
    """The devices of a robot, as a factory of their drivers. Mutable: notes what they are commanded.

    Args:
        program: the program on these devices.
        readings: what the sensors read in each frame, over and over.
        time: the time.
    """

    def __init__(
        self, program: Program, readings: Sequence[Mapping[str, FrameReading]], time: Callable[[], int]
    ) -> None:
        self._readings = readings
        self._frame_ns = program.robot.frame_ns
        self._servers = {s.name: s.server for s in program.robot.sensors if s.sent is None}
        self._time = time
        self.commands: list[Command] = []

    def read(self, server: str) -> dict[str, FrameReading]:
        """Return what the sensors of a server read now."""
        readings = self._readings[self._time() // self._frame_ns % len(self._readings)]
        return {name: value for name, value in readings.items() if self._servers.get(name) == server}

    def note(self, server: str, command: str, values: object) -> None:
        """Note a command."""
        self.commands.append((self._time(), server, command, repr(values)))

    def base(
        self, device: Device, robot: str, limits: BaseLimits, origin_ns: int, resources: ExitStack
    ) -> BaseDriver:
        """Return the driver of the base."""
        return _Base(self, self._time)

    def proximity(
        self, device: Device, robot: str, count: int, origin_ns: int, resources: ExitStack
    ) -> ProximityDriver:
        """Raise: the robot has no ring."""
        raise NotImplementedError

    def camera(
        self, device: Device, robot: str, camera: str, origin_ns: int, resources: ExitStack
    ) -> CameraDriver:
        """Raise: the robot has no camera."""
        raise NotImplementedError

    def device(self, device: Device, robot: str, server: str, resources: ExitStack) -> DeviceDriver:
        """Return the driver of a device."""
        return _Device(self, server)


class _Base:
    """A base that stands still, with a bumper that touches something now and then."""

    limits = LIMITS
    register_bits = None

    def __init__(self, plant: Plant, time: Callable[[], int]) -> None:
        self._plant = plant
        self._time = time

    def drive(self, velocity: float, turn: float) -> None:
        """Note the speeds."""
        self._plant.note(RSERVER.name, "drive", (velocity, turn))

    def stop(self) -> None:
        """Note the stop."""
        self._plant.note(RSERVER.name, "stop", ())

    def state(self) -> BaseState:
        """Return the state."""
        now_ns = self._time()
        touches = now_ns // 50_000_000 % 7 == 0
        return BaseState(
            t_ns=now_ns,
            x=1.0,
            y=2.0,
            heading=3.0,
            front_bumper=touches,
            rear_bumper=False,
            speed=4.0,
            turn_rate=5.0,
            wheel_speed=6.0,
        )


class _Device:
    """A device that reads what the plant does, and notes what it is commanded."""

    def __init__(self, plant: Plant, server: str) -> None:
        self._plant = plant
        self._server = server

    def fields(self) -> Mapping[str, Reading | None]:
        """Return the readings, as old as they are said to be."""
        return {
            name: None if value is None else Reading(value, 0)  # type: ignore[arg-type]  # may be invalid
            for name, value in self._plant.read(self._server).items()
        }

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        """Note a command."""
        self._plant.note(self._server, name, dict(values))

    def safe(self) -> None:
        """Note that the device is made safe."""
        self._plant.note(self._server, "safe", ())

    def close(self) -> None:
        """Do nothing."""
