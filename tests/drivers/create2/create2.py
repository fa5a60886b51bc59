"""The case of the fuzzer for frames of the stream, with a second reading of them."""

from __future__ import annotations

import random

from colony.drivers.create2.codec import Frame, decoder, encoded
from colony.drivers.create2.sensors import STREAM
from tests.drivers.fuzz import Case

WIDTHS = dict.fromkeys((7, 9, 10, 11, 12, 14, 17, 21, 34, 35, 45, 52, 53, 58), 1) | dict.fromkeys(
    (22, 23, 25, 26, 41, 42, 43, 44, 46, 47, 48, 49, 50, 51), 2
)
"""Sizes of the packets of the stream, written down a second time."""

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
    return encoded(Frame(STREAM, bytes(data)))


CASE = Case(decoder=decoder, packet=_packet, frame_at=frame_at, raw=encoded, longest=COUNT + 3)
