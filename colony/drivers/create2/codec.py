"""Frames of the Open Interface's stream, and its commands. Pure: bytes to frames, and commands to bytes.

A frame is `19 N id data id data ... sum`. The sum of all its bytes, the 19 among them, is 0 modulo 256; the
example of the Create 1 manual leaves the 19 out (182 for 163). 19 occurs in data as well, so that a frame
counts only if it has exactly the packets that were asked for, in their order.

Commands have neither a frame nor a checksum: an opcode and data, big endian.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from colony.drivers.create2.sensors import STREAM, size_of, values_of
from colony.drivers.decoder import Need, SlidingDecoder

HEADER = 19

MAX_WHEEL = 500
"""Greatest speed of a wheel, in mm/s."""

STRAIGHT = 0x7FFF
"""The radius that means straight ahead; 0x8000 means the same."""


class Opcode(IntEnum):
    """The opcodes of the Create 2."""

    RESET = 7
    START = 128
    BAUD = 129
    CONTROL = 130
    SAFE = 131
    FULL = 132
    POWER = 133
    SPOT = 134
    CLEAN = 135
    MAX = 136
    DRIVE = 137
    MOTORS = 138
    LEDS = 139
    SONG = 140
    PLAY = 141
    SENSORS = 142
    DOCK = 143
    PWM_MOTORS = 144
    DRIVE_DIRECT = 145
    DRIVE_PWM = 146
    STREAM = 148
    QUERY_LIST = 149
    PAUSE_RESUME = 150
    SCHEDULING_LEDS = 162
    DIGITS_RAW = 163
    DIGITS_ASCII = 164
    BUTTONS = 165
    SCHEDULE = 167
    SET_DAY_TIME = 168
    STOP = 173


DATA_SIZES: dict[int, int] = {
    Opcode.BAUD: 1,
    Opcode.DRIVE: 4,
    Opcode.MOTORS: 1,
    Opcode.LEDS: 3,
    Opcode.PLAY: 1,
    Opcode.SENSORS: 1,
    Opcode.PWM_MOTORS: 3,
    Opcode.DRIVE_DIRECT: 4,
    Opcode.DRIVE_PWM: 4,
    Opcode.PAUSE_RESUME: 1,
    Opcode.SCHEDULING_LEDS: 2,
    Opcode.DIGITS_RAW: 4,
    Opcode.DIGITS_ASCII: 4,
    Opcode.BUTTONS: 1,
    Opcode.SCHEDULE: 15,
    Opcode.SET_DAY_TIME: 3,
}
"""Number of data bytes where it is fixed and not 0; SONG, STREAM and QUERY_LIST count theirs."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame of the stream: the ids that were asked for, and the data behind each, joined."""

    ids: tuple[int, ...]
    data: bytes

    def values(self) -> dict[str, int]:
        """Return the values of the packets by name."""
        return values_of(self.ids, self.data)


def command(opcode: Opcode, *data: int) -> bytes:
    """Return a command of single bytes.

    Example:
        >>> command(Opcode.STREAM, 2, 29, 13).hex(" ")
        '94 02 1d 0d'
    """
    return bytes([opcode, *data])


def drive_direct(right: int, left: int) -> bytes:
    """Return the command that sets the speeds of both wheels in mm/s: the right one comes first.

    Raises:
        ValueError: a wheel cannot be as fast.
    """
    if max(abs(right), abs(left)) > MAX_WHEEL:
        raise ValueError(f"wheels at {right} and {left} mm/s; at most {MAX_WHEEL} is possible")
    return struct.pack(">Bhh", Opcode.DRIVE_DIRECT, right, left)


def drive(velocity: int, radius: int = STRAIGHT) -> bytes:
    """Return the command of a speed in mm/s along a radius in mm, positive to the left.

    Raises:
        ValueError: a value is out of range.
    """
    if abs(velocity) > MAX_WHEEL or not (abs(radius) <= 2000 or radius in (STRAIGHT, -0x8000)):
        raise ValueError(f"drive({velocity}, {radius}): at most {MAX_WHEEL} mm/s and 2000 mm are possible")
    return struct.pack(">Bhh", Opcode.DRIVE, velocity, radius)


def stream(ids: tuple[int, ...]) -> bytes:
    """Return the command that starts the stream of these packets."""
    return command(Opcode.STREAM, len(ids), *ids)


def encoded(frame: Frame) -> bytes:
    """Return the bytes of a frame."""
    body, at = bytearray(), 0
    for number in frame.ids:
        size = size_of(number)
        body += bytes([number]) + frame.data[at : at + size]
        at += size
    whole = bytes([HEADER, len(body)]) + body
    return whole + bytes([-sum(whole) % 256])


def decoder(ids: tuple[int, ...] = STREAM) -> SlidingDecoder[Frame]:
    """Return a decoder of the frames that have exactly these packets."""
    places, at = list[tuple[int, int, int]](), 0  # the id, and where its data begins and ends in the body
    for number in ids:
        places.append((number, at + 1, at + 1 + size_of(number)))
        at = places[-1][2]
    count = at

    def parse(stream: bytearray, start: int) -> tuple[Frame, int] | Need:
        if len(stream) < start + 2:
            return "more"
        if stream[start + 1] != count:
            return "other"
        body = start + 2
        if any(body + at <= len(stream) and stream[body + at - 1] != number for number, at, _ in places):
            return "other"
        end = body + count + 1
        if len(stream) < end:
            return "more"
        if sum(stream[start:end]) % 256:
            return "other"
        data = b"".join(stream[body + first : body + last] for _, first, last in places)
        return Frame(ids, data), end

    return SlidingDecoder(parse, bytes([HEADER]))


class CommandReader:
    """Takes commands apart, as the robot does, which has no way to find their beginnings. Mutable."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Return the complete commands: opcodes and data. Unknown opcodes have none."""
        self._data += data
        found: list[tuple[int, bytes]] = []
        while self._data and (size := self._size()) <= len(self._data):
            found.append((self._data[0], bytes(self._data[1:size])))
            del self._data[:size]
        return found

    def _size(self) -> int:
        """Return the size of the first command, as far as it is known."""
        opcode = self._data[0]
        if opcode in (Opcode.STREAM, Opcode.QUERY_LIST):
            return 2 + self._data[1] if len(self._data) > 1 else 2
        if opcode == Opcode.SONG:
            return 3 + 2 * self._data[2] if len(self._data) > 2 else 3
        return 1 + DATA_SIZES.get(opcode, 0)
