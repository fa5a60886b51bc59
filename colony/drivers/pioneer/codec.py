"""The frame and the commands of Pioneer robots. Pure: bytes to the data of packets, and commands to bytes.

Both directions have one frame: FA FB, a count of the bytes behind it, data, and a checksum, big endian. All
other integers are little endian. The first byte of the data says what it is.

Sources: Pioneer 2 and Pioneer 3 operations manuals (packet, checksum, command arguments).
"""

from __future__ import annotations

from enum import IntEnum

from colony.drivers.dialect import Need, SlidingDecoder

HEADER = b"\xfa\xfb"

MAX_COUNT = 249
"""Greatest count of a packet (AROS manual); P2OS ends at 197, so that nothing longer comes from there."""

MAX_ARGUMENT = 0xFFFF

POSITIVE, NEGATIVE, STRING = 0x3B, 0x1B, 0x2B
"""Types of arguments: an integer, a negative one by its magnitude, a string behind its length."""


class CommandNumber(IntEnum):
    """The numbers of commands. 0 to 2 mean SYNC0 to SYNC2 until the session is open."""

    PULSE = 0
    OPEN = 1
    CLOSE = 2
    ENABLE = 4
    SETA = 5
    SETV = 6
    SETO = 7
    MOVE = 8
    ROTATE = 9
    SETRV = 10
    VEL = 11
    HEAD = 12
    DHEAD = 13
    CONFIG = 18
    ENCODER = 19
    RVEL = 21
    SETRA = 23
    SONAR = 28
    STOP = 29
    VEL2 = 32
    BUMPSTALL = 44
    JOYDRIVE = 47
    SONAR_CYCLE = 48
    ESTOP = 55


def checksum(data: bytes) -> int:
    """Return the checksum of the data of a packet: the sum of its pairs, and an odd byte by exclusive or.

    Example:
        >>> checksum(bytes([4, 0x3B, 1, 0])) == 0x053B
        True
    """
    even = len(data) & ~1
    total = sum(data[0:even:2]) * 256 + sum(data[1:even:2])
    return (total & 0xFFFF) ^ (data[-1] if len(data) > even else 0)


def encoded(data: bytes) -> bytes:
    """Return the packet of `data`.

    Raises:
        ValueError: there is no data, or too much.
    """
    count = len(data) + 2
    if not 3 <= count <= MAX_COUNT:
        raise ValueError(f"a packet has 1 to {MAX_COUNT - 2} bytes of data; found {len(data)}")
    return HEADER + bytes([count]) + data + checksum(data).to_bytes(2, "big")


def command(number: int, argument: int | bytes | None = None) -> bytes:
    """Return the packet of a command.

    Raises:
        ValueError: the argument does not fit.

    Example:
        >>> command(Command.VEL, -300).hex(" ")
        'fa fb 06 0b 1b 2c 01 37 1c'
    """
    match argument:
        case None:
            return encoded(bytes([number]))
        case bytes():
            return encoded(bytes([number, STRING, len(argument)]) + argument)
        case _:
            if abs(argument) > MAX_ARGUMENT:
                raise ValueError(f"an argument is at most {MAX_ARGUMENT}; found {argument}")
            sign = POSITIVE if argument >= 0 else NEGATIVE
            return encoded(bytes([number, sign]) + abs(argument).to_bytes(2, "little"))


def argument_of(data: bytes) -> int | bytes | None:
    """Return the argument of a command from its data; None if it has none, or a damaged one."""
    kind, value = data[1:2], data[2:]
    if kind in (bytes([POSITIVE]), bytes([NEGATIVE])) and len(value) >= 2:
        magnitude = int.from_bytes(value[:2], "little")
        return magnitude if kind[0] == POSITIVE else -magnitude
    if kind == bytes([STRING]) and value and len(value) > value[0]:
        return value[1 : 1 + value[0]]
    return None


def decoder() -> SlidingDecoder[bytes]:
    """Return a decoder of the data of packets, whose first byte is the type."""
    return SlidingDecoder(_parse, HEADER)


def _parse(stream: bytearray, at: int) -> tuple[bytes, int] | Need:
    if len(stream) < at + 3:
        return "more"
    count = stream[at + 2]
    if not 3 <= count <= MAX_COUNT:
        return "other"
    end = at + 3 + count
    if len(stream) < end:
        return "more"
    data = bytes(stream[at + 3 : end - 2])
    return (data, end) if checksum(data) == int.from_bytes(stream[end - 2 : end], "big") else "other"
