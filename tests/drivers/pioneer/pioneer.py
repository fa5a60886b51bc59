"""The case of the fuzzer for the codec of Pioneer robots, with a second reading of its frame."""

from __future__ import annotations

import random
import struct
from functools import cache

from colony.drivers.emulator import STEP_S, room
from colony.drivers.pioneer.codec import MAX_COUNT, command, decoder, encoded
from colony.drivers.pioneer.firmware import PioneerFirmware
from colony.drivers.pioneer.parameters import MODELS
from colony.drivers.pioneer.pioneer import Pioneer
from tests.drivers.fuzz import Case
from tests.drivers.fuzz_device import Device

MOTION = (8, 9, 11, 12, 13, 21, 32)
"""Numbers of the commands that move the base, unless their argument is 0."""


def second_checksum(data: bytes) -> int:
    """Return the checksum, computed from the other end: each byte on its own, then an odd one."""
    total, odd = 0, 0
    for i, byte in enumerate(data):
        if i % 2 == 0 and i == len(data) - 1:
            odd = byte
        else:
            total += byte << (8 if i % 2 == 0 else 0)
    return (total % 65536) ^ odd


def frame_at(stream: bytes, at: int) -> int:
    """Return the length of the valid frame that begins at a place of a stream, 0 for none."""
    if stream[at : at + 2] != b"\xfa\xfb" or at + 2 >= len(stream):
        return 0
    size = stream[at + 2]
    frame = stream[at + 3 : at + 3 + size]
    if not 3 <= size <= 249 or len(frame) < size:
        return 0
    return size + 3 if struct.pack(">H", second_checksum(frame[:-2])) == frame[-2:] else 0


def _packet(rng: random.Random) -> bytes:
    """Draw a standard packet, an answer, a command, or any data; headers occur within."""
    kind = rng.randrange(4)
    if kind == 0:
        count = rng.randrange(9)
        body = rng.randbytes(21) + bytes([count]) + rng.randbytes(3 * count + rng.choice((5, 14)))
        return encoded(bytes([rng.choice((0x32, 0x33))]) + body)
    if kind == 1:
        return encoded(bytes([2]) + b"Name\0Pioneer\0p3dx-sh\0")
    if kind == 2:
        return command(rng.randrange(64), rng.choice((None, rng.randrange(-2000, 2000), b"\x01\x02")))
    return encoded(rng.choice((b"\xfa\xfb", b"\xfa", b"")) + rng.randbytes(rng.randrange(1, 60)))


@cache
def recording() -> list[bytes]:
    """Return the packets that an emulated robot sends from its handshake on, on a way around a room."""
    robot = PioneerFirmware(MODELS["p3dx-sh"], around=room(4000.0, 3000.0))
    for packet in (
        *map(command, (0, 1, 2, 1)),
        command(4, 1),
        command(28, 1),
        command(18, 1),
        command(19, 2),
    ):
        robot.receive(packet)
    sent: list[bytes] = []
    for i in range(6000):
        if i % 200 == 0:
            robot.receive(
                command(11, (400, -150, 300)[i // 200 % 3]) + command(21, (0, 40, -30)[i // 200 % 3])
            )
        for _ in range(round(0.02 / STEP_S)):
            robot.step()
        sent += robot.sent()
    return sent


def moves(data: bytes) -> bool:
    """Return True if commands move the base, which has a session and its motors on."""
    at = 0
    while at < len(data):
        size = frame_at(data, at)
        if size == 0 or (data[at + 3] in MOTION and any(data[at + 5 : at + 7])):
            return True
        at += size
    return False


DEVICE = Device(
    dialect=Pioneer,
    recording=recording,
    period_s=0.1,
    limits={"sonar": (0.0, 5000.0), "volts": (0.0, 60.0), "battery": (0.0, 100.0)},
    max_speed=1.2 * 2200.0,
    max_turn=1.2 * 500.0,
    moves=moves,
)

CASE = Case(
    decoder=decoder,
    packet=_packet,
    frame_at=frame_at,
    raw=encoded,
    longest=MAX_COUNT + 3,
    header=b"\xfa\xfb\x03\x32",
    device=DEVICE,
)
