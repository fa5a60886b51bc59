"""The case of the fuzzer for frames of the stream, with a second reading of them."""

from __future__ import annotations

import random
from functools import cache

from colony.drivers.create2.codec import (
    STREAM,
    CommandReader,
    StreamFrame,
    command,
    decoder,
    drive_direct,
    encoded,
    stream,
)
from colony.drivers.create2.create2 import Create2
from colony.drivers.create2.firmware import Create2Firmware, EmulatedWorld
from colony.drivers.emulator import room
from tests.drivers.fuzz import Case
from tests.drivers.fuzz_device import Device

WIDTHS = dict.fromkeys((7, 9, 10, 11, 12, 14, 17, 21, 34, 35, 45, 52, 53, 58), 1) | dict.fromkeys(
    (22, 23, 25, 26, 41, 42, 43, 44, 46, 47, 48, 49, 50, 51), 2
)
"""Sizes of the packets of the stream, written down a second time."""

MOTION = (134, 135, 136, 143, 153, 154, 155, 156)
"""Opcodes that make the robot drive by itself: to clean, to its dock, by a script."""

SPEEDS = (137, 145, 146)
"""Opcodes of speeds, unless they are 0."""

COUNT = len(STREAM) + sum(WIDTHS[number] for number in STREAM)


def frame_at(stream: bytes, at: int) -> int:
    """Return the length of the valid frame that begins at a place of a stream, 0 for none."""
    frame = stream[at : at + COUNT + 3]
    if len(frame) < COUNT + 3 or frame[0] != 0x13 or frame[1] != COUNT:
        return 0
    place = 2
    for number in STREAM:
        if frame[place] != number:
            return 0
        place += 1 + WIDTHS[number]
    rest = 0
    for byte in reversed(frame):
        rest = (rest - byte) & 0xFF
    return len(frame) if rest == 0 else 0


def _packet(rng: random.Random) -> bytes:
    """Draw a frame; headers, and counts behind them, occur within."""
    size = sum(WIDTHS[number] for number in STREAM)
    data = bytearray(rng.randbytes(size))
    for _ in range(rng.randrange(4)):
        at = rng.randrange(size - 1)
        data[at : at + 2] = bytes([0x13, rng.choice((COUNT, 7, 0x13))])
    return encoded(StreamFrame(STREAM, bytes(data)))


@cache
def recording() -> list[bytes]:
    """Return the frames that an emulated robot sends on a way around a room."""
    robot = Create2Firmware(EmulatedWorld(range=room(2000.0, 2000.0)))
    robot.receive(command(128) + command(131) + stream(STREAM))
    sent: list[bytes] = []
    for i in range(6000):
        if i % 300 == 0:
            robot.receive(drive_direct(*((300, 300), (-100, -100), (80, -80))[i // 300 % 3]))
        robot.step()
        sent += robot.sent()
    return sent


def moves(data: bytes) -> bool:
    """Return True if commands move the base, which is in safe mode."""
    return any(
        opcode in MOTION or (opcode in SPEEDS and any(rest)) for opcode, rest in CommandReader().feed(data)
    )


DEVICE = Device(
    dialect=Create2,
    recording=recording,
    period_s=0.015,
    limits={
        "battery": (0.0, 100.0),
        "volts": (5.0, 22.0),
        "mode": (0.0, 4.0),
        "range": (0.0, 300.0),
    },
    max_speed=600.0,
    max_turn=300.0,
    moves=moves,
)

CASE = Case(
    decoder=decoder,
    packet=_packet,
    frame_at=frame_at,
    raw=encoded,
    longest=COUNT + 3,
    header=bytes([0x13, COUNT, STREAM[0]]),
    device=DEVICE,
)
