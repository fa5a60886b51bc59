"""The tiny protocol of the tests: a base with two encoders and a battery, in frames of `A5 N data sum`.

From the base: `01 x:i16 y:i16 heading:u16` (mm, 0.01 deg), `02 volts:u8` (0.1 V), `03 i:u8 mm:u16` (one sonar
of four), `04` (hello). To the base: `10` (hello), `11 velocity:i16 turn:i16` (mm/s, deg/s), `12` (goodbye).
Little endian; the sum of all bytes but the first is 0 modulo 256.
"""

from __future__ import annotations

import random
import struct

from colony.drivers.decoder import Need, SlidingDecoder
from tests.drivers.fuzz import Case

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


CASE = Case(decoder=decoder, packet=_packet, frame_at=_frame_at, raw=encoded, longest=LONGEST)
