"""The ports of a plant, to which connections attach, and the messages that each allows. No I/O.

A message that is not allowed raises `ValueError`, whose text is returned to the sender.
"""

from __future__ import annotations

from colony.sim.plant.devices import Devices
from colony.sim.plant.protocol import (
    Advance,
    AskTruth,
    Attach,
    AttachBase,
    AttachCamera,
    AttachControl,
    AttachProximity,
    BaseReading,
    CameraReading,
    Device,
    Done,
    DriveBase,
    FromPlant,
    Halt,
    Place,
    ProximityReading,
    Reading,
    Refusal,
    Sense,
    ToPlant,
)


def checked_attachment(message: ToPlant, devices: Devices) -> Attach:
    """Check the first message of a connection, which must attach it to a device or to the control.

    Raises:
        ValueError: the message does not attach, or the plant has no such robot or camera.
    """
    match message:
        case AttachCamera(robot=robot, camera=camera):
            devices.check_camera(camera)
            devices.number(robot)
        case AttachBase(robot=robot) | AttachProximity(robot=robot):
            devices.number(robot)
        case AttachControl():
            pass
        case _:
            raise _not_allowed(message)
    return message


def reading(port: Device, devices: Devices, number: int = 0) -> Reading:
    """Return the reading of the device at this port, with the number of the request."""
    match port:
        case AttachBase():
            return BaseReading(value=devices.base(devices.number(port.robot)), number=number)
        case AttachProximity():
            return ProximityReading(value=devices.proximity(devices.number(port.robot)), number=number)
        case AttachCamera():
            image = devices.image(devices.number(port.robot), port.camera)
            return CameraReading(value=image, number=number)


def answer(port: Attach, message: ToPlant, devices: Devices, logical_ns: int | None) -> FromPlant | None:
    """Handle a message, and return the answer if there is one.

    An error on a control connection is answered by a refusal, and the connection stays open.

    Args:
        port: the port to which the connection is attached.
        message: the message.
        devices: the devices.
        logical_ns: the logical time that passes with each command; None in real time.
    """
    if isinstance(port, AttachControl):
        try:
            return _handle_control(message, devices, logical_ns)
        except ValueError as problem:
            return Refusal(message=str(problem))
    if isinstance(message, Sense):
        return reading(port, devices, message.number)
    if not isinstance(port, AttachBase):
        raise _not_allowed(message)
    robot = devices.number(port.robot)
    match message:
        case Halt():
            devices.halt(robot)
        case DriveBase():
            devices.drive(robot, message.velocity, message.turn)
            if logical_ns is not None:
                devices.pass_time(logical_ns)
                return reading(port, devices, message.number)
        case _:
            raise _not_allowed(message)
    return None


def _handle_control(message: ToPlant, devices: Devices, logical_ns: int | None) -> FromPlant:
    match message:
        case AskTruth():
            return devices.truth(devices.number(message.robot))
        case Place():
            devices.place(devices.number(message.robot), message.x, message.y, message.heading)
        case Advance() if logical_ns is not None:
            devices.pass_time(message.dt_ns)
        case _:
            raise _not_allowed(message)
    return Done()


def _not_allowed(message: ToPlant) -> ValueError:
    return ValueError(f"{type(message).__name__} is not allowed on this connection")
