"""The case of the fuzzer for the codec of Pioneer robots, with a second reading of its frame."""

from __future__ import annotations

import random
import struct

from colony.drivers.pioneer.codec import MAX_COUNT, command, decoder, encoded
from tests.drivers.fuzz import Case


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


CASE = Case(decoder=decoder, packet=_packet, frame_at=frame_at, raw=encoded, longest=MAX_COUNT + 3)
