"""The protocol between the simulated devices and their drivers, over unix sockets of packets.

A message is a packet: one byte of version, then msgpack. The first message attaches a connection to a device.
From then on the plant sends readings by itself, and the driver sends commands. On a control connection the
plant only answers requests.

    driver   -> plant    AttachBase, AttachProximity, AttachCamera, AttachDevice
    plant    -> driver   Attached, then BaseReading, ProximityReading, CameraReading or DeviceReading
                         periodically
    driver   -> plant    DriveBase, HaltBase; DeviceCommand, MakeSafe
    control  -> plant    AttachControl, then AskTruth, PlaceRobot, Give, AskDoors, MoveDoors, RideElevator,
                         each answered by Truth, Doors, Landed, Done or Refusal

Times are those of the machine's monotonic clock in nanoseconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import msgspec

from colony.ir.types import ScalarValue
from colony.runtime.protocol.images import Image
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.drivers import BaseState
from colony.sim.mechanism import GivenValue

VERSION = 7

MAX_BYTES_TO_PLANT = 65536
MAX_BYTES_FROM_PLANT = 512 * 1024
"""Bytes of the largest message in each direction; the operating system takes no larger packet."""

M = TypeVar("M")
Value = TypeVar("Value")


class _Message(msgspec.Struct, frozen=True, kw_only=True, tag=True, array_like=True):
    """A message, encoded as an array that begins with the message's name."""


# --- to the plant --------------------------------------------------------------------------------


class AttachBase(_Message, frozen=True, kw_only=True):
    """A request to attach to a robot's base; it displaces an idle driver, but not one in command."""

    robot: str


class AttachProximity(_Message, frozen=True, kw_only=True):
    """A request to attach to a robot's sonars and infrared detectors."""

    robot: str


class AttachCamera(_Message, frozen=True, kw_only=True):
    """A request to attach to a robot's camera."""

    robot: str
    camera: str


class AttachDevice(_Message, frozen=True, kw_only=True):
    """A request to attach to the device of a robot's server."""

    robot: str
    server: str


class AttachControl(_Message, frozen=True, kw_only=True):
    """A request for a control connection, which belongs to no robot."""


class DriveBase(_Message, frozen=True, kw_only=True):
    """A command to drive at `velocity` mm/s, turn at `turn` deg/s, and drive `sideways` mm/s to the left.

    It is valid until the watchdog expires.
    """

    velocity: float
    turn: float
    sideways: float = 0.0


class HaltBase(_Message, frozen=True, kw_only=True):
    """A command to stop."""


class DeviceCommand(_Message, frozen=True, kw_only=True):
    """A command of a device by name, with its parameters."""

    name: str
    values: Mapping[str, ScalarValue]


class MakeSafe(_Message, frozen=True, kw_only=True):
    """A command to make a device safe, which the plant also does when the connection ends."""


class AskTruth(_Message, frozen=True, kw_only=True):
    """A request for the true state of a robot."""

    robot: str


class PlaceRobot(_Message, frozen=True, kw_only=True):
    """A request to move a robot to another pose, unnoticed by its odometry."""

    robot: str
    x: float
    y: float
    heading: float


class Give(_Message, frozen=True, kw_only=True):
    """A request that a field of a device reads a value from `t_ns` on, until the connection ends.

    `value` is in base units, "missing" for a field without a value, None for what the device measures.
    """

    robot: str
    server: str
    field: str
    t_ns: int
    value: GivenValue


class AskDoors(_Message, frozen=True, kw_only=True):
    """A request for the opening of the doors of the elevator at a node of the robots' floor."""

    node: str


class MoveDoors(_Message, frozen=True, kw_only=True):
    """A request to open the doors of the elevator at a node of the robots' floor, or to close them."""

    node: str
    is_opening: bool


class RideElevator(_Message, frozen=True, kw_only=True):
    """A request to take the robots in the elevator at a node to the floor of another map."""

    node: str
    floor: str


# --- from the plant ------------------------------------------------------------------------------


class Attached(_Message, frozen=True, kw_only=True):
    """The confirmation of an attachment.

    `began_ns` is the start time of the plant, which distinguishes a process from its replacement.
    """

    began_ns: int


class Refusal(_Message, frozen=True, kw_only=True):
    """The refusal of a request, with the reason; it ends the connection of a device."""

    message: str


class Done(_Message, frozen=True, kw_only=True):
    """The confirmation that a request is done."""


class Doors(_Message, frozen=True, kw_only=True):
    """The opening of an elevator's doors, from 0 (shut) to 1."""

    opening: float


class Landed(_Message, frozen=True, kw_only=True):
    """The end of a ride: the node of the doors on the new floor."""

    node: str


class FieldReading(NamedTuple):
    """What a field of a device read at `t_ns`; an element is None if it is invalid, infinite without echo."""

    value: ScalarValue | tuple[ScalarValue | None, ...]
    t_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RingReadings:
    """The ranges in mm and the detections of a robot's rings; None before the first have arrived."""

    sonar: Sample | None
    infrared: Sample | None


class _Reading(_Message, Generic[Value], frozen=True, kw_only=True):
    """What a device reads at `t_ns`, with the times of its measurements."""

    value: Value
    t_ns: int


class BaseReading(_Reading[BaseState | None], frozen=True, kw_only=True):
    """The state of a base; None before the first has arrived."""


class ProximityReading(_Reading[RingReadings], frozen=True, kw_only=True):
    """The newest scans of both rings."""


class CameraReading(_Reading[Image], frozen=True, kw_only=True):
    """An image of a camera."""


class DeviceReading(_Reading[Mapping[str, FieldReading | None]], frozen=True, kw_only=True):
    """The readings of a device by field, None for one that has no value."""


class Truth(_Message, frozen=True, kw_only=True):
    """The true state of a robot at `t_ns`.

    It has the name of the map of its floor, the position in mm, the heading in degrees, speeds in mm/s and
    deg/s (`sideways` to the left), and the distance driven so far in mm. `bumps` is the number of collisions.
    `driven` is True if the base got a command within the watchdog's time. `skipped_ns` is the time that the
    plant skipped because of lag, `people` are the positions of the people on the floor in mm.
    """

    t_ns: int
    floor: str
    x: float
    y: float
    heading: float
    velocity: float
    turn: float
    sideways: float
    distance: float
    bumps: int
    driven: bool
    skipped_ns: int
    people: tuple[tuple[float, float], ...] = ()


Device = AttachBase | AttachProximity | AttachCamera | AttachDevice
Attach = Device | AttachControl
Control = AskTruth | PlaceRobot | Give | AskDoors | MoveDoors | RideElevator
ToPlant = Attach | DriveBase | HaltBase | DeviceCommand | MakeSafe | Control
Reading = BaseReading | ProximityReading | CameraReading | DeviceReading
FromPlant = Attached | Refusal | Done | Reading | Truth | Doors | Landed


class PlantProtocolError(ValueError):
    """A packet that is not a message of this protocol."""


_PREFIX = bytes([VERSION])
_encoder = msgspec.msgpack.Encoder()
_from_plant: msgspec.msgpack.Decoder[FromPlant] = msgspec.msgpack.Decoder(FromPlant)
_to_plant: msgspec.msgpack.Decoder[ToPlant] = msgspec.msgpack.Decoder(ToPlant)


def pack(message: ToPlant | FromPlant) -> bytes:
    """Pack a message into a packet."""
    return _PREFIX + _encoder.encode(message)


def read_to_plant(packet: bytes) -> ToPlant:
    """Read the message to the plant in a packet.

    Raises:
        PlantProtocolError: the packet is not a message.
    """
    return _read(packet, _to_plant)


def read_from_plant(packet: bytes | memoryview) -> FromPlant:
    """Read the message from the plant in a packet.

    Raises:
        PlantProtocolError: the packet is not a message.
    """
    return _read(packet, _from_plant)


def _read(packet: bytes | memoryview, decoder: msgspec.msgpack.Decoder[M]) -> M:
    if packet[:1] != _PREFIX:
        raise PlantProtocolError(f"found version {packet[0] if packet else 'none'}; expected {VERSION}")
    try:
        return decoder.decode(memoryview(packet)[1:])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise PlantProtocolError(str(problem) or type(problem).__name__) from None
