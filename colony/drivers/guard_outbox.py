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
    the line has carried those before it. Stops and decisions have a channel: a newer one replaces only those
    of its own channel, and decisions of several channels take turns.
    """

    def __init__(self, baud: int) -> None:
        self._baud = baud
        self._rest = b""  # of a packet that was written in part: it is finished before anything else
        self._stops: dict[int, tuple[bytes, list[int]]] = {}  # by channel, with the times at which it is due
        self._decided: dict[int, bytes] = {}  # by channel, those that have waited longest first
        self._plain: deque[bytes] = deque()
        self._line_free_ns = 0
        self._taken = 0  # bytes that the port has taken
        self._newest: int | None = None  # the channel whose newest stop or decision was handed out last
        self._sent: dict[int, tuple[int, int] | None] = {}  # bytes taken and time at the end of the newest

    def stop(self, stop: bytes, now_ns: int, channel: int = 0, *, drops_plain: bool = True) -> None:
        """Drop the decision that waits, and plain packets if asked to; send `stop` repeatedly from now on."""
        self._decided.pop(channel, None)
        if drops_plain:
            self._plain.clear()
        self._expect(channel, None if stop else (0, 0))
        if stop:
            self._stops[channel] = stop, [now_ns + after_ns for after_ns in REPEATS_NS]

    def decide(self, packet: bytes, channel: int = 0) -> None:
        """Send what was decided, in place of an older decision that waits, and repeat the stop no longer."""
        self._decided[channel] = packet  # an older one keeps its turn
        self._expect(channel, None)

    def _expect(self, channel: int, end: tuple[int, int] | None) -> None:
        """Expect the end of a newer stop or decision, and repeat an older stop no longer."""
        self._stops.pop(channel, None)
        self._sent[channel] = end
        if self._newest == channel:
            self._newest = None

    def add(self, packet: bytes) -> None:
        """Send a plain packet after those before it."""
        if len(self._plain) < MAX_WAITING:
            self._plain.append(packet)

    def clear(self) -> None:
        """Forget everything: the port is lost."""
        for waiting in (self._stops, self._decided, self._plain, self._sent):
            waiting.clear()
        self._rest, self._line_free_ns, self._newest = b"", 0, None

    def is_sent(self, now_ns: int, channel: int = 0, *, unsent: int = 0) -> bool | None:
        """Return True once the line has carried a channel's newest stop or decision; None if it had none.

        `unsent` is the number of bytes that the port has taken and not sent.
        """
        if channel not in self._sent:
            return None
        end = self._sent[channel]
        return end is not None and self._taken - unsent >= end[0] and now_ns >= end[1]

    def due_ns(self) -> int | None:
        """Return when the next packet is due; None if none waits."""
        if self._rest or self._decided or self._plain:
            return self._line_free_ns
        due_ns = min((times[0] for _, times in self._stops.values()), default=None)
        return None if due_ns is None else max(due_ns, self._line_free_ns)

    def next(self, now_ns: int) -> bytes:
        """Return what is to be written now, whose rest `wrote` takes back; nothing if the line is busy."""
        if now_ns < self._line_free_ns:
            return b""
        packet, self._rest = self._rest, b""
        if packet:
            return packet
        for channel, (stop, times) in self._stops.items():
            if now_ns >= times[0]:
                self._newest = channel
                times.pop(0)
                if not times:
                    del self._stops[channel]
                return stop
        if self._decided:
            self._newest = next(iter(self._decided))
            return self._decided.pop(self._newest)
        self._newest = None
        return self._plain.popleft() if self._plain else b""

    def wrote(self, packet: bytes, taken: int, now_ns: int) -> None:
        """Note that the port took `taken` bytes of a packet."""
        self._rest = packet[taken:]
        self._taken += taken
        wire_ns = taken * 10_000_000_000 // self._baud if self._baud else 0
        self._line_free_ns = now_ns + max(wire_ns, NO_ROOM_NS if self._rest else 0)
        if self._newest is not None and not self._rest and self._sent[self._newest] is None:
            self._sent[self._newest] = self._taken, self._line_free_ns
