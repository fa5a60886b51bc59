"""The protocol between the simulated devices and their drivers, over unix stream sockets.

A message is four bytes of length, most significant first, one byte of version, then msgpack. The first
message attaches a connection to a device. From then on the plant sends readings by itself, and the driver
sends commands. On a control connection the plant only answers requests.

    driver   -> plant    AttachBase, AttachProximity, AttachCamera
    plant    -> driver   Attached, then BaseReading, ProximityReading, CameraReading periodically
    driver   -> plant    DriveBase, Halt; Sense, in logical time
    control  -> plant    AttachControl, then AskTruth, Place, Advance, each answered by Truth, Done or Refusal

Times are those of the machine's monotonic clock in nanoseconds. Logical time advances only by commands, and
the plant sends nothing by itself: `DriveBase` advances time by a frame, and `DriveBase` and `Sense` are
answered by a reading with the same `number`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

import msgspec

from colony.runtime.protocol.images import Image
from colony.runtime.servers.drivers import BaseState

VERSION = 2

MAX_BYTES_TO_PLANT = 4096
MAX_BYTES_FROM_PLANT = 8 * 1024 * 1024
"""Bytes of the largest message in each direction."""

_LENGTH_BYTES = 4

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


class AttachControl(_Message, frozen=True, kw_only=True):
    """A request for a control connection, which belongs to no robot."""


class DriveBase(_Message, frozen=True, kw_only=True):
    """A command to drive at `velocity` mm/s and turn at `turn` deg/s, valid until the watchdog expires."""

    velocity: float
    turn: float
    number: int = 0


class Halt(_Message, frozen=True, kw_only=True):
    """A command to stop."""


class Sense(_Message, frozen=True, kw_only=True):
    """A request for a reading."""

    number: int


class AskTruth(_Message, frozen=True, kw_only=True):
    """A request for the true state of a robot."""

    robot: str


class Place(_Message, frozen=True, kw_only=True):
    """A request to move a robot to another pose, unnoticed by its odometry."""

    robot: str
    x: float
    y: float
    heading: float


class Advance(_Message, frozen=True, kw_only=True):
    """A request to advance logical time."""

    dt_ns: int


# --- from the plant ------------------------------------------------------------------------------


class Attached(_Message, frozen=True, kw_only=True):
    """The confirmation of an attachment.

    `logical` is True if time advances only by commands. `began_ns` is the start time of the plant, which
    distinguishes a process from its replacement.
    """

    logical: bool
    began_ns: int = 0


class Refusal(_Message, frozen=True, kw_only=True):
    """The refusal of a request, with the reason; it ends the connection of a device."""

    message: str


class Done(_Message, frozen=True, kw_only=True):
    """The confirmation that a request is done."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rings:
    """The ranges in mm and the detections of a robot's rings, taken at `t_ns`."""

    t_ns: int
    sonar: tuple[float, ...]
    infrared: tuple[bool, ...]


class _Reading(_Message, Generic[Value], frozen=True, kw_only=True):
    """A reading of a device; `number` is that of the request."""

    value: Value
    number: int = 0


class BaseReading(_Reading[BaseState], frozen=True, kw_only=True):
    """The state of a base."""


class ProximityReading(_Reading[Rings], frozen=True, kw_only=True):
    """A scan of both rings."""


class CameraReading(_Reading[Image], frozen=True, kw_only=True):
    """An image of a camera."""


class Truth(_Message, frozen=True, kw_only=True):
    """The true state of a robot at `t_ns`.

    It has the position in mm, the heading in degrees, speeds in mm/s and deg/s, and the distance driven so
    far in mm. `bumps` is the number of collisions. `driven` is True if the base got a command within the
    watchdog's time. `skipped_ns` is the time that the plant skipped because of lag.
    """

    t_ns: int
    x: float
    y: float
    heading: float
    velocity: float
    turn: float
    distance: float
    bumps: int
    driven: bool
    skipped_ns: int


Device = AttachBase | AttachProximity | AttachCamera
Attach = Device | AttachControl
ToPlant = Attach | DriveBase | Halt | Sense | AskTruth | Place | Advance
Reading = BaseReading | ProximityReading | CameraReading
FromPlant = Attached | Refusal | Done | Reading | Truth


class PlantProtocolError(ValueError):
    """Bytes violate the protocol; the bytes after them cannot be read either."""


_encoder = msgspec.msgpack.Encoder()
_from_plant: msgspec.msgpack.Decoder[FromPlant] = msgspec.msgpack.Decoder(FromPlant)
_to_plant: msgspec.msgpack.Decoder[ToPlant] = msgspec.msgpack.Decoder(ToPlant)


def pack(message: ToPlant | FromPlant) -> bytes:
    """Pack a message for a socket."""
    body = _encoder.encode(message)
    return (len(body) + 1).to_bytes(_LENGTH_BYTES, "big") + bytes([VERSION]) + body


def read_to_plant(payload: bytes) -> ToPlant:
    """Read the message to the plant in a payload.

    Raises:
        PlantProtocolError: the payload is not a message.
    """
    return _read(payload, _to_plant)


def read_from_plant(payload: bytes) -> FromPlant:
    """Read the message from the plant in a payload.

    Raises:
        PlantProtocolError: the payload is not a message.
    """
    return _read(payload, _from_plant)


def _read(payload: bytes, decoder: msgspec.msgpack.Decoder[M]) -> M:
    if payload[:1] != bytes([VERSION]):
        raise PlantProtocolError(f"found version {payload[0] if payload else 'none'}; expected {VERSION}")
    try:
        return decoder.decode(memoryview(payload)[1:])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise PlantProtocolError(str(problem) or type(problem).__name__) from None


class Unpacker:
    """A splitter of a byte stream into payloads. Stateful: keeps the incomplete payload."""

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._rest = bytearray()

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Yield every complete payload.

        Raises:
            PlantProtocolError: the length of a payload is 0 or larger than allowed.
        """
        self._rest += data
        while len(self._rest) >= _LENGTH_BYTES:
            length = int.from_bytes(self._rest[:_LENGTH_BYTES], "big")
            if not 0 < length <= self._max_bytes:
                raise PlantProtocolError(f"a message of {length} bytes; expected 1 to {self._max_bytes}")
            if len(self._rest) < _LENGTH_BYTES + length:
                return
            payload = bytes(self._rest[_LENGTH_BYTES : _LENGTH_BYTES + length])
            del self._rest[: _LENGTH_BYTES + length]
            yield payload
