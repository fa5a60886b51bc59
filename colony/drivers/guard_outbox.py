"""What a guard has to write: whole packets, the stop first, at the line's pace. Pure: times are given."""

from __future__ import annotations

from collections import deque

REPEATS_NS = (0, 50_000_000, 150_000_000, 350_000_000)
"""Times after a stop at which it is sent: repeatedly, in case that a byte was lost on the line."""

NO_ROOM_NS = 2_000_000
"""Pause after the port took only a part of a packet."""

MAX_WAITING = 200
"""Maximum number of plain packets that wait; more are dropped."""


class Outbox:
    """The packets that wait for a port of `baud` (8N1; 0: not paced). Mutable.

    What the operating system has taken cannot be dropped any more, so that the outbox hands out a packet when
    the line has carried those before it.
    """

    def __init__(self, baud: int) -> None:
        self._baud = baud
        self._rest = b""  # of a packet that was written in part: it is finished before anything else
        self._stop = b""
        self._stops_due: list[int] = []
        self._decided = b""
        self._plain: deque[bytes] = deque()
        self._line_free_ns = 0
        self._is_newest = False  # what was handed out last is the newest stop or decision
        self._is_sent: bool | None = None

    def stop(self, stop: bytes, now_ns: int, *, drops_plain: bool = True) -> None:
        """Drop the decision that waits, and plain packets if asked to; send `stop` repeatedly from now on."""
        self._decided, self._stop = b"", stop
        self._is_newest, self._is_sent = False, not stop
        if drops_plain:
            self._plain.clear()
        self._stops_due = [now_ns + after_ns for after_ns in REPEATS_NS] if stop else []

    def decide(self, packet: bytes) -> None:
        """Send what was decided, in place of an older decision that waits, and repeat the stop no longer."""
        self._decided, self._stops_due = packet, []
        self._is_newest = self._is_sent = False

    def add(self, packet: bytes) -> None:
        """Send a plain packet after those before it."""
        if len(self._plain) < MAX_WAITING:
            self._plain.append(packet)

    def clear(self) -> None:
        """Forget everything: the port is lost."""
        self.stop(b"", 0)
        self._rest, self._line_free_ns = b"", 0
        self._is_sent = None

    def is_sent(self, now_ns: int) -> bool | None:
        """Return True once the line has carried the newest stop or decision; None if there was none."""
        return self._is_sent and now_ns >= self._line_free_ns

    def due_ns(self) -> int | None:
        """Return when the next packet is due; None if none waits."""
        if self._rest or self._decided or self._plain:
            return self._line_free_ns
        return max(self._stops_due[0], self._line_free_ns) if self._stops_due else None

    def next(self, now_ns: int) -> bytes:
        """Return what is to be written now, whose rest `wrote` takes back; nothing if the line is busy."""
        if now_ns < self._line_free_ns:
            return b""
        packet, self._rest = self._rest, b""
        if packet:
            return packet
        self._is_newest = True
        if self._stops_due and now_ns >= self._stops_due[0]:
            self._stops_due.pop(0)
            return self._stop
        if self._decided:
            packet, self._decided = self._decided, b""
            return packet
        self._is_newest = False
        return self._plain.popleft() if self._plain else b""

    def wrote(self, packet: bytes, taken: int, now_ns: int) -> None:
        """Note that the port took `taken` bytes of a packet."""
        self._rest = packet[taken:]
        if self._is_newest and not self._rest:
            self._is_sent = True
        wire_ns = taken * 10_000_000_000 // self._baud if self._baud else 0
        self._line_free_ns = now_ns + max(wire_ns, NO_ROOM_NS if self._rest else 0)
