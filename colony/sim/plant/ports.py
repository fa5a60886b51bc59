"""What a connection of the plant is attached to, and what it may say there. No I/O.

What is not allowed where it is said raises `ValueError`, whose text goes back to who said it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, assert_never

from colony.sim.plant.devices import Devices
from colony.sim.plant.protocol import (
    Advance,
    AskTruth,
    AttachBase,
    AttachCamera,
    AttachControl,
    AttachProximity,
    Done,
    Drive,
    FromPlant,
    Halt,
    Place,
    Reading,
    Refusal,
    Sense,
    ToPlant,
)


class Port(Protocol):
    """What is behind one connection."""

    def take(self, message: ToPlant, devices: Devices, logical_ns: int | None) -> FromPlant | None:
        """Do what is asked; gives the answer. `logical_ns` is what passes with a command in logical time."""
        ...

    def reading(self, devices: Devices) -> Reading | None:
        """What the device reads."""
        ...


@dataclass(frozen=True, slots=True)
class UnattachedPort:
    """Nothing yet: the first message attaches the connection."""

    def attach(self, message: ToPlant, devices: Devices) -> Port:
        """What the connection is attached to from now on."""
        match message:
            case AttachBase():
                return BasePort(devices.number(message.robot))
            case AttachProximity():
                return ProximityPort(devices.number(message.robot))
            case AttachCamera():
                devices.check_camera(message.camera)
                return CameraPort(devices.number(message.robot), message.camera)
            case AttachControl():
                return ControlPort()
            case Drive() | Halt() | Sense() | AskTruth() | Place() | Advance():
                raise _misplaced(message)
            case _:
                assert_never(message)

    def take(self, message: ToPlant, devices: Devices, logical_ns: int | None) -> FromPlant | None:
        raise _misplaced(message)

    def reading(self, devices: Devices) -> Reading | None:
        return None


@dataclass(frozen=True, slots=True)
class BasePort:
    """The base of a robot. In logical time each command lets time pass, and is answered."""

    robot: int

    def take(self, message: ToPlant, devices: Devices, logical_ns: int | None) -> FromPlant | None:
        if isinstance(message, Drive):
            devices.drive(self.robot, message.velocity, message.turn)
            if logical_ns is None:
                return None
            devices.pass_time(logical_ns)
            return devices.base(self.robot, message.number)
        if isinstance(message, Halt):
            devices.halt(self.robot)
            return None
        if isinstance(message, Sense):
            return devices.base(self.robot, message.number)
        raise _misplaced(message)

    def reading(self, devices: Devices) -> Reading | None:
        return devices.base(self.robot)


@dataclass(frozen=True, slots=True)
class ProximityPort:
    """The sonars and infrared detectors of a robot."""

    robot: int

    def take(self, message: ToPlant, devices: Devices, logical_ns: int | None) -> FromPlant | None:
        if isinstance(message, Sense):
            return devices.proximity(self.robot, message.number)
        raise _misplaced(message)

    def reading(self, devices: Devices) -> Reading | None:
        return devices.proximity(self.robot)


@dataclass(frozen=True, slots=True)
class CameraPort:
    """A camera of a robot."""

    robot: int
    camera: str

    def take(self, message: ToPlant, devices: Devices, logical_ns: int | None) -> FromPlant | None:
        if isinstance(message, Sense):
            return devices.image(self.robot, self.camera, message.number)
        raise _misplaced(message)

    def reading(self, devices: Devices) -> Reading | None:
        return devices.image(self.robot, self.camera)


@dataclass(frozen=True, slots=True)
class ControlPort:
    """Somebody outside the robots: what goes wrong here is said, and the connection stands."""

    def take(self, message: ToPlant, devices: Devices, logical_ns: int | None) -> FromPlant | None:
        try:
            return self._answer(message, devices, logical_ns)
        except ValueError as problem:
            return Refusal(message=str(problem))

    def reading(self, devices: Devices) -> Reading | None:
        return None

    def _answer(self, message: ToPlant, devices: Devices, logical_ns: int | None) -> FromPlant:
        match message:
            case AskTruth():
                return devices.truth(devices.number(message.robot))
            case Place():
                devices.place(devices.number(message.robot), message.x, message.y, message.heading)
            case Advance() if logical_ns is not None:
                devices.pass_time(message.dt_ns)
            case _:
                raise _misplaced(message)
        return Done()


def _misplaced(message: ToPlant) -> ValueError:
    return ValueError(f"{type(message).__name__} does not belong here")
