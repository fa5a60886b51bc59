"""Decoders: what a device sends, from bytes to packets. Pure: no I/O, no clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Literal, Protocol, TypeVar

Packet = TypeVar("Packet")


class Decoder(Protocol[Packet]):
    """Decodes the bytes of one line, in any pieces. Mutable: keeps the beginning of an unfinished packet.

    A decoder accepts garbage: it never raises, and holds no more bytes than the longest packet has. Where the
    bytes at hand are not a valid packet, it drops the first of them and looks again ("slides"), so that a
    damaged packet, or a false beginning, costs no valid packet behind it. Packets are frozen values, and
    have what the checksum covers; what a packet means is decided by the dialect.

    `tests/drivers/fuzz.py` holds every decoder to that.
    """

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that end within `data`, oldest first."""
        ...


Need = Literal["more", "other"]
"""Why there is no packet at a place: it is not complete, or it is none."""

Parse = Callable[[bytearray, int], tuple[Packet, int] | Need]
"""A function that reads one packet.

Args: the bytes, and the place where a packet may begin, which has the decoder's `start`.
Returns: the packet and the place behind it; "more" if it may be one, but is not complete; "other" if it is
    none, whatever follows. It says "other" as early as it can, for example when the length is impossible.
Raises: ValueError, which stands for "other", such as that of a checksum that is no number.
"""


class SlidingDecoder(Generic[Packet]):
    """A decoder of packets that begin with fixed bytes and have a length and a checksum. Mutable.

    Args:
        parse: reads one packet.
        start: the bytes, at least one, with which each packet begins.

    Example:
        >>> def parse(data: bytearray, at: int) -> tuple[int, int] | Need:
        ...     if len(data) < at + 3:
        ...         return "more"
        ...     value, check = data[at + 1 : at + 3]
        ...     return (value, at + 3) if value ^ check == 0xFF else "other"
        >>> SlidingDecoder(parse, bytes([0xA5])).feed(bytes([0xA5, 1, 0xA5, 7, 0xF8]))
        [7]
    """

    def __init__(self, parse: Parse[Packet], start: bytes) -> None:
        self._parse = parse
        self._start = start
        self._data = bytearray()

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that end within `data`, oldest first."""
        self._data += data
        packets: list[Packet] = []
        at = 0
        while (found := self._data.find(self._start, at)) >= 0:
            try:
                read = self._parse(self._data, found)
            except ValueError:
                read = "other"
            if read == "more":
                at = found
                break
            if read == "other":
                at = found + 1
            else:
                packet, at = read
                packets.append(packet)
        else:
            at = max(at, len(self._data) - len(self._start) + 1)  # the rest may be half of a start
        del self._data[:at]
        return packets
