"""The ports of a plant, to which connections attach, and the messages that each allows. No I/O.

A message that is not allowed raises `ValueError`, whose text is returned to the sender.
"""

from __future__ import annotations

from colony.sim.plant.hardware import Devices
from colony.sim.plant.protocol import (
    Advance,
    AskDoors,
    AskTruth,
    Attach,
    AttachBase,
    AttachCamera,
    AttachControl,
    AttachDevice,
    AttachProximity,
    BaseReading,
    CameraReading,
    Device,
    DeviceCommand,
    DeviceReading,
    Done,
    Doors,
    DriveBase,
    FromPlant,
    Give,
    Halt,
    Landed,
    MoveDoors,
    Place,
    ProximityReading,
    Reading,
    Refusal,
    Ride,
    Safe,
    Sense,
    ToPlant,
)


def checked_attachment(message: ToPlant, devices: Devices) -> Attach:
    """Check the first message of a connection, which must attach it to a device or to the control.

    Raises:
        ValueError: the message does not attach, or the plant has no such robot, camera or device.
    """
    match message:
        case AttachCamera(robot=robot, camera=camera):
            devices.check_camera(camera)
            devices.number(robot)
        case AttachDevice(robot=robot, server=server):
            devices.check_device(devices.number(robot), server)
        case AttachProximity(robot=robot):
            devices.check_proximity(devices.number(robot))
        case AttachBase(robot=robot):
            devices.number(robot)
        case AttachControl():
            pass
        case _:
            raise _not_allowed(message)
    return message


def reading(port: Device, devices: Devices, number: int = 0) -> Reading:
    """Return the reading of the device at this port, with the number of the request."""
    robot, t_ns = devices.number(port.robot), devices.time_ns
    match port:
        case AttachBase():
            return BaseReading(value=devices.base(robot), t_ns=t_ns, number=number)
        case AttachProximity():
            return ProximityReading(value=devices.proximity(robot), t_ns=t_ns, number=number)
        case AttachCamera():
            return CameraReading(value=devices.image(robot, port.camera), t_ns=t_ns, number=number)
        case AttachDevice():
            return DeviceReading(value=devices.device(robot, port.server), t_ns=t_ns, number=number)


def answer(
    port: Attach, message: ToPlant, devices: Devices, logical_ns: int | None, *, sender: object = None
) -> FromPlant | None:
    """Handle a message, and return the answer if there is one.

    An error on a control connection is answered by a refusal, and the connection stays open.

    Args:
        port: the port to which the connection is attached.
        message: the message.
        devices: the devices.
        logical_ns: the logical time that passes with each command; None in real time.
        sender: the connection, until whose end its values of fields are given.
    """
    if isinstance(port, AttachControl):
        try:
            return _handle_control(message, devices, logical_ns, sender)
        except ValueError as problem:
            return Refusal(message=str(problem))
    if isinstance(message, Sense):
        return reading(port, devices, message.number)
    robot = devices.number(port.robot)
    match port, message:
        case AttachBase(), Halt():
            devices.halt(robot)
        case AttachBase(), DriveBase():
            devices.drive(robot, message.velocity, message.turn, message.sideways)
            if logical_ns is not None:
                devices.pass_time(logical_ns)
                return reading(port, devices, message.number)
        case AttachDevice(server=server), DeviceCommand():
            devices.command(robot, server, message.name, message.values)
        case AttachDevice(server=server), Safe():
            devices.safe(robot, server)
        case _:
            raise _not_allowed(message)
    return None


def _handle_control(message: ToPlant, devices: Devices, logical_ns: int | None, sender: object) -> FromPlant:
    match message:
        case AskTruth():
            return devices.truth(devices.number(message.robot))
        case Place():
            devices.place(devices.number(message.robot), message.x, message.y, message.heading)
        case Give():
            robot = devices.number(message.robot)
            devices.give(sender, robot, message.server, message.field, message.t_ns, message.value)
        case Advance() if logical_ns is not None:
            devices.pass_time(message.dt_ns)
        case AskDoors(node=node):
            return Doors(opening=devices.elevators.opening(node))
        case MoveDoors(node=node, is_opening=True):
            devices.elevators.open(node)
        case MoveDoors(node=node):
            devices.elevators.close(node)
        case Ride(node=node, floor=floor):
            return Landed(node=devices.elevators.ride(node, floor))
        case _:
            raise _not_allowed(message)
    return Done()


def _not_allowed(message: ToPlant) -> ValueError:
    return ValueError(f"{type(message).__name__} is not allowed on this connection")
