"""The protocol between the simulated devices and their drivers, over unix stream sockets.

Each message is four bytes of length, most significant first, one byte of version, then msgpack. A connection
begins with what it is attached to, and is that device's cable from then on: readings come by themselves,
commands go the other way. A control connection asks and is answered instead.

    driver   -> plant    AttachBase, AttachProximity, AttachCamera
    plant    -> driver   Attached, then BaseReading, ProximityReading, CameraReading again and again
    driver   -> plant    DriveBase, Halt; Sense, in logical time
    anyone   -> plant    AttachControl, then AskTruth, Place, Advance, each answered by Truth, Done or Refusal

Times are those of the machine's monotonic clock in nanoseconds. In logical time, which stands still but for
commands, nothing comes by itself: `DriveBase` lets a frame pass, and `DriveBase` and `Sense` are answered by
a reading with the same `number`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

import msgspec

from colony.runtime.protocol.images import Image
from colony.runtime.servers.drivers import BaseState

VERSION = 2

LARGEST_TO_PLANT = 4096
LARGEST_FROM_PLANT = 8 * 1024 * 1024
"""Bytes of the largest message in each direction."""

_LENGTH = 4

M = TypeVar("M")
Taken = TypeVar("Taken")


class _Message(msgspec.Struct, frozen=True, kw_only=True, tag=True, array_like=True):
    """A message: in bytes, an array that begins with the message's name."""


# --- to the plant --------------------------------------------------------------------------------


class AttachBase(_Message, frozen=True, kw_only=True):
    """A request for a robot's base; a driver in command keeps it, an idle one loses it to the next."""

    robot: str


class AttachProximity(_Message, frozen=True, kw_only=True):
    """This is a cable of a robot's sonars and infrared detectors."""

    robot: str


class AttachCamera(_Message, frozen=True, kw_only=True):
    """This is a cable of one of a robot's cameras."""

    robot: str
    camera: str


class AttachControl(_Message, frozen=True, kw_only=True):
    """This connection stands outside the robots."""


class DriveBase(_Message, frozen=True, kw_only=True):
    """Go at `velocity` mm/s, turning `turn` deg/s; it holds for as long as the watchdog waits."""

    velocity: float
    turn: float
    number: int = 0


class Halt(_Message, frozen=True, kw_only=True):
    """Stand still."""


class Sense(_Message, frozen=True, kw_only=True):
    """Give a reading now."""

    number: int


class AskTruth(_Message, frozen=True, kw_only=True):
    """A request for the true state of a robot."""

    robot: str


class Place(_Message, frozen=True, kw_only=True):
    """Carry a robot there; its odometry does not notice."""

    robot: str
    x: float
    y: float
    heading: float


class Advance(_Message, frozen=True, kw_only=True):
    """A request to let logical time pass."""

    dt_ns: int


# --- from the plant ------------------------------------------------------------------------------


class Attached(_Message, frozen=True, kw_only=True):
    """The answer that the device is there.

    `logical`: its time passes by commands only. `began_ns` is when the plant began; it distinguishes a
    process from another one started in its place.
    """

    logical: bool
    began_ns: int = 0


class Refusal(_Message, frozen=True, kw_only=True):
    """The answer that a request is refused, and why. On a device's connection it ends it."""

    message: str


class Done(_Message, frozen=True, kw_only=True):
    """The answer that a request is done."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rings:
    """The ranges in mm and the detections of a robot's rings, taken at `t_ns`."""

    t_ns: int
    sonar: tuple[float, ...]
    infrared: tuple[bool, ...]


class _Reading(_Message, Generic[Taken], frozen=True, kw_only=True):
    """A reading of a device; `number` is that of the message that asked for it."""

    taken: Taken
    number: int = 0


class BaseReading(_Reading[BaseState], frozen=True, kw_only=True):
    """The state of a base."""


class ProximityReading(_Reading[Rings], frozen=True, kw_only=True):
    """A scan of both rings."""


class CameraReading(_Reading[Image], frozen=True, kw_only=True):
    """An image of a camera."""


class Truth(_Message, frozen=True, kw_only=True):
    """The true state of a robot at `t_ns`, whatever it believes.

    Position in mm, heading in degrees, speeds in mm/s and deg/s, the way driven so far in mm. `bumps` counts
    its collisions. `driven`: its base has a connection, and was commanded within the watchdog's time.
    `skipped_ns` is the time that the plant was too late to simulate.
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
    """These bytes are not the protocol; what comes after them cannot be read either."""


_encoder = msgspec.msgpack.Encoder()
_from_plant: msgspec.msgpack.Decoder[FromPlant] = msgspec.msgpack.Decoder(FromPlant)
_to_plant: msgspec.msgpack.Decoder[ToPlant] = msgspec.msgpack.Decoder(ToPlant)


def pack(message: ToPlant | FromPlant) -> bytes:
    """Pack a message for a socket."""
    body = _encoder.encode(message)
    return (len(body) + 1).to_bytes(_LENGTH, "big") + bytes([VERSION]) + body


def read_to_plant(payload: bytes) -> ToPlant:
    """Read the message in a payload.

    Raises:
        PlantProtocolError: there is none.
    """
    return _read(payload, _to_plant)


def read_from_plant(payload: bytes) -> FromPlant:
    """Read the message in a payload, for the other direction."""
    return _read(payload, _from_plant)


def _read(payload: bytes, decoder: msgspec.msgpack.Decoder[M]) -> M:
    if payload[:1] != bytes([VERSION]):
        raise PlantProtocolError(f"found version {payload[0] if payload else 'none'}; expected {VERSION}")
    try:
        return decoder.decode(memoryview(payload)[1:])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise PlantProtocolError(str(problem) or type(problem).__name__) from None


class Unpacker:
    """Cuts what a stream gives into payloads. Mutable: what has come of the next one."""

    def __init__(self, largest: int) -> None:
        self._largest = largest
        self._rest = bytearray()

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Return every payload that is complete.

        Raises:
            PlantProtocolError: one claims to be empty or larger than allowed.
        """
        self._rest += data
        while len(self._rest) >= _LENGTH:
            length = int.from_bytes(self._rest[:_LENGTH], "big")
            if not 0 < length <= self._largest:
                raise PlantProtocolError(f"a message of {length} bytes; expected 1 to {self._largest}")
            if len(self._rest) < _LENGTH + length:
                return
            payload = bytes(self._rest[_LENGTH : _LENGTH + length])
            del self._rest[: _LENGTH + length]
            yield payload
