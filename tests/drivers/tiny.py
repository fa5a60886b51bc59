"""The tiny protocol of the tests: a base with two encoders and a battery, in frames of `A5 N data sum`.

From the base: `01 x:i16 y:i16 heading:u16` (mm, 0.01 deg), `02 volts:u8` (0.1 V), `03 i:u8 mm:u16` (one sonar
of four), `04` (hello). To the base: `10` (hello), `11 velocity:i16 turn:i16` (mm/s, deg/s), `12` (goodbye),
`13 speed:i8` (mm/s, the jaw of its gripper). Little endian; the sum of all bytes but the first is 0 modulo
256.
"""

from __future__ import annotations

import random
import struct
from functools import cache
from typing import ClassVar

from colony.drivers.dialect import (
    NOTHING,
    Ask,
    Dialect,
    Need,
    Opening,
    OpeningError,
    Readings,
    Send,
    SlidingDecoder,
)
from colony.drivers.odometry import OdometryPose, Registers
from colony.drivers.serial_base import SerialActuators, SerialBase, SerialFields
from colony.runtime.servers.drivers import BaseState
from tests.drivers.fuzz import Case
from tests.drivers.fuzz_device import Device

START = 0xA5
LONGEST = 40


def encoded(data: bytes) -> bytes:
    """Return the frame of `data`."""
    body = bytes([len(data)]) + data
    return bytes([START]) + body + bytes([-sum(body) % 256])


def parse(data: bytearray, at: int) -> tuple[bytes, int] | Need:
    """Read a frame."""
    if len(data) < at + 2:
        return "more"
    size = data[at + 1]
    if not 1 <= size <= LONGEST - 3:
        return "other"
    end = at + size + 3
    if len(data) < end:
        return "more"
    return (bytes(data[at + 2 : end - 1]), end) if sum(data[at + 1 : end]) % 256 == 0 else "other"


def decoder() -> SlidingDecoder[bytes]:
    """Return a decoder of the data of frames."""
    return SlidingDecoder(parse, bytes([START]))


def _packet(rng: random.Random) -> bytes:
    kind = rng.choice(
        (
            lambda: struct.pack(
                "<BhhH", 1, *(rng.randrange(-900, 900) for _ in range(2)), rng.randrange(36000)
            ),
            lambda: bytes([2, rng.randrange(256)]),
            lambda: struct.pack("<BBH", 3, rng.randrange(4), rng.randrange(5000)),
            lambda: bytes([4]),
        )
    )
    return encoded(kind())


def _frame_at(stream: bytes, at: int) -> int:
    if stream[at] != START or at + 1 == len(stream) or not 0 < stream[at + 1] < LONGEST - 2:
        return 0
    frame = stream[at : at + 3 + stream[at + 1]]
    total = 0
    for byte in frame[1:]:
        total = (total + byte) & 0xFF
    return len(frame) if total == 0 and len(frame) == 3 + stream[at + 1] else 0


HELLO, SPEEDS, GOODBYE, JAW = 0x10, 0x11, 0x12, 0x13
"""Kinds of frames to the base."""


class Tiny(Dialect[bytes]):
    """The dialect of the tiny protocol."""

    baud = 115_200
    delay_ns = 1_000_000
    stop_bytes = encoded(struct.pack("<Bhh", SPEEDS, 0, 0))
    goodbye = encoded(bytes([GOODBYE]))
    jaw_stop = encoded(bytes([JAW, 0]))
    rings: ClassVar = {"sonar": 4}
    bounds: ClassVar = {"volts": (0.0, 20.0), "sonar": (0.0, 5000.0)}
    max_speed = 600.0
    max_turn = 200.0
    silent_s = 1.0

    def __init__(self) -> None:
        self._registers = Registers(16, 16, max_rate=1000.0)
        self._pose = OdometryPose()

    def decoder(self) -> SlidingDecoder[bytes]:
        return decoder()

    def opening(self) -> Opening[bytes]:
        for _ in range(3):
            answer = yield Ask(encoded(bytes([HELLO])), lambda packet: packet[0] == 4, timeout_s=0.5)
            if answer is not None:
                yield Send(b"", 0.01)
                return
        raise OpeningError("the tiny robot does not answer: is it switched on?")

    def restart(self) -> None:
        self._registers.restart()

    def read(self, packet: bytes, t_ns: int) -> Readings:
        match packet[0]:
            case 1:
                x, y, heading = struct.unpack_from("<hhH", packet, 1)
                (dx, dy), _ = self._registers.step((x, y), t_ns)
                self._pose = OdometryPose(self._pose.x + dx, self._pose.y + dy, heading / 100)
                return Readings(base=_state(self._pose, t_ns))
            case 2:
                return Readings(fields={"volts": packet[1] / 10})
            case 3:
                number, mm = struct.unpack_from("<BH", packet, 1)
                return Readings(elements={"sonar": {number: float(mm)}})
        return NOTHING

    def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> bytes:
        return encoded(struct.pack("<Bhh", SPEEDS, round(velocity), round(turn)))

    def jaw(self, speed: float) -> bytes:
        """Return the bytes that close the gripper at a speed in mm/s."""
        return encoded(struct.pack("<Bb", JAW, round(speed)))


def _state(pose: OdometryPose, t_ns: int) -> BaseState:
    return BaseState(
        t_ns=t_ns,
        x=pose.x,
        y=pose.y,
        heading=pose.heading,
        front_bumper=False,
        rear_bumper=False,
        speed=0.0,
        turn_rate=0.0,
        wheel_speed=0.0,
    )


def base(port: str, baud: int = 0, frame_ns: int = 50_000_000) -> SerialBase[bytes]:
    """Return the driver of the base."""
    return SerialBase(Tiny(), port, baud=baud, frame_ns=frame_ns)


def battery(port: str, baud: int = 0) -> SerialFields[bytes]:
    """Return the driver of the battery."""
    return SerialFields(Tiny(), port, {"level": "volts"}, baud=baud)


def gripper(port: str, baud: int = 0, frame_ns: int = 50_000_000) -> SerialActuators[bytes]:
    """Return the driver of the gripper."""
    return SerialActuators(Tiny(), port, {}, {"jaw": Tiny.jaw_stop}, baud=baud, frame_ns=frame_ns)


@cache
def _recording() -> list[bytes]:
    found = []
    for i in range(300):
        found += [
            encoded(struct.pack("<BhhH", 1, i * 9, (i * 5) % 90, i * 20)),
            encoded(bytes([2, 124])),
            *(encoded(struct.pack("<BBH", 3, k, 1000 + i + k)) for k in range(4)),
        ]
    return found


def _moves(data: bytes) -> bool:
    return any(frame[0] in (SPEEDS, JAW) and any(frame[1:]) for frame in decoder().feed(data))


DEVICE = Device(
    dialect=Tiny,
    recording=_recording,
    period_s=0.005,
    limits={"volts": (0.0, 20.0), "sonar": (0.0, 5000.0)},
    max_speed=1000.0,
    max_turn=200.0,
    moves=_moves,
)

CASE = Case(
    decoder=decoder,
    packet=_packet,
    frame_at=_frame_at,
    raw=encoded,
    longest=LONGEST,
    header=bytes([START, 2]),
    device=DEVICE,
)
