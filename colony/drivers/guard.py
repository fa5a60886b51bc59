"""The guard of a port: the one process that holds a serial port, and stops the base when its driver dies.

Drivers connect over a unix socket of packets (`guard_packets.py`), and all get what arrives from the port. At
most one connection commands. It has a channel for each actuator, such as the base and a gripper: the hello of
a channel has the bytes that stop the actuator, those that end the session, and a deadline.

- Decided bytes carry out the frame that was just decided. Only the commanding driver sends them, a newer
  packet replaces one of its channel that waits, and one that is older than the deadline is dropped.
- When the deadline of a channel passes without another, or its driver asks for it, its decision that waits is
  dropped and its stop is sent, repeatedly. When the commanding connection ends, when the port reopens, and
  when the guard ends, that is done for all channels. Plain packets are dropped as well, unless the driver
  asks for the stop. If the handshake comes first, a new line hears the driver first.
- A packet that is half written is finished first, so that the stop is never part of another packet.
- The commanding driver may ask whether the stop of a channel was sent: the answer comes once the bytes have
  left this computer, or says why they cannot. The driver kills a guard that does not answer, and starts the
  next one.
- The guard itself sends nothing but that and the goodbye, at its end, 2 s after its last driver: only
  decisions keep a base moving.
"""

from __future__ import annotations

import os
import selectors
import signal
import socket
import struct
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from colony.backoff import Backoff
from colony.drivers import guard_packets as kinds
from colony.drivers.link import ByteLink, open_link
from colony.files import ClaimedError, FileClaim

# --- guard outbox -------------------------------------------------------------------------------------
#
# What a guard has to write: whole packets, the stop first, at the line's pace. Pure: times are given.

REPEATS_NS = (0, 50_000_000, 150_000_000, 350_000_000)
"""Times after a stop at which it is sent: repeatedly, in case that a byte was lost on the line."""

NO_ROOM_NS = 2_000_000
"""Pause after the port took only a part of a packet."""

MAX_WAITING = 200
"""Maximum number of plain packets that wait; more are dropped."""


class PacketQueue:
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


# --- guard process ------------------------------------------------------------------------------------
#
# What makes a process the guard of a port: a lock that it holds, the socket beside it, and its signals.


def claimed(path: str) -> socket.socket | None:
    """Return the listening socket at `path`; None if another process guards the port.

    The lock is `path` with `.lock`, and contains the process id.
    """
    try:
        claim = FileClaim(f"{path}.lock")  # until this process ends
    except ClaimedError:
        return None
    with suppress(OSError):  # where the disk is full, nobody learns the process id
        claim.sign()
    with suppress(FileNotFoundError):
        os.unlink(path)  # of a guard that was killed
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(path)
    listener.setblocking(False)
    listener.listen()
    return listener


def on_signals(selector: selectors.BaseSelector, end: Callable[[], None]) -> None:
    """Call `end` at SIGTERM and SIGINT, which wake the selector."""
    woken, wake = socket.socketpair()
    woken.setblocking(False)
    wake.setblocking(False)
    selector.register(woken, selectors.EVENT_READ, lambda: woken.recv(64))
    signal.set_wakeup_fd(wake.detach())
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: end())


# --- guard port ---------------------------------------------------------------------------------------
#
# The port of a guard: opened again with increasing pauses when it is lost, written at the line's pace.

RETRY_NS = (100_000_000, 2_000_000_000)
"""Pauses before a lost port is opened again: the first, which doubles, and the longest."""

STABLE_NS = 1_000_000_000
"""Time in ns after which a port that is lost is opened again without a pause."""


class GuardedPort:
    """A port and what waits for it. Mutable; of the guard's thread.

    Attributes:
        is_new: whether the port is open, and nothing was sent since it was opened.

    Args:
        name: what `open_link` opens.
        baud: the baud rate of a serial port; 0 leaves it as it is.
        selector: waits for the port's bytes.
        on_data: takes bytes that arrived.
        on_status: called when the port was opened (None), and when it cannot be opened or is lost (why).
    """

    def __init__(
        self,
        name: str,
        baud: int,
        selector: selectors.BaseSelector,
        on_data: Callable[[bytes], None],
        on_status: Callable[[str | None], None],
    ) -> None:
        self.name, self.baud = name, baud
        self.outbox = PacketQueue(baud)
        self._selector = selector
        self._on_data = on_data
        self._on_status = on_status
        self.is_new = False
        self._link: ByteLink | None = None
        self._retry_ns, self._opened_ns = 0, 0
        self._retries = Backoff(*RETRY_NS)

    @property
    def is_open(self) -> bool:
        """True while bytes can be sent."""
        return self._link is not None

    def is_sent(self, channel: int) -> bool | None:
        """Return True once a channel's newest stop or decision has left this computer; None without one."""
        if self._link is None:
            return None
        return self.outbox.is_sent(time.monotonic_ns(), channel, unsent=self._link.unsent())

    def due_ns(self) -> int | None:
        """Return when `do_what_is_due` has something to do."""
        return self._retry_ns if self._link is None else self.outbox.due_ns()

    def do_what_is_due(self) -> None:
        """Write what the line has room for, and open a port that is lost."""
        try:
            while self._link is not None and (packet := self.outbox.next(time.monotonic_ns())):
                self.is_new = False
                self.outbox.wrote(packet, self._link.write(packet), time.monotonic_ns())
        except OSError as problem:
            self._lose(f"{self.name} is lost: {problem.strerror or problem}")
        if self._link is None and time.monotonic_ns() >= self._retry_ns:
            self._open()

    def write_all(self, within_ns: int) -> None:
        """Write all that is due before `within_ns` have passed, and wait for it."""
        until_ns = time.monotonic_ns() + within_ns
        while self.is_open and (due_ns := self.outbox.due_ns()) is not None and due_ns < until_ns:
            time.sleep(max(0, due_ns - time.monotonic_ns()) / 1e9)
            self.do_what_is_due()

    def close(self) -> None:
        """Release the port; what it is lost for is nobody's concern any more."""
        if self._link is not None:
            self._link.close()

    def _open(self) -> None:
        try:
            self._link = open_link(self.name, self.baud)
        except OSError as problem:
            self._lose(str(problem))
            return
        self.is_new, self._opened_ns = True, time.monotonic_ns()
        self._selector.register(self._link, selectors.EVENT_READ, self._read)
        self._retries.reset()
        self._on_status(None)

    def _read(self) -> None:
        try:
            data = self._link.read() if self._link is not None else b""
        except OSError as problem:
            self._lose(f"{self.name} is lost: {problem.strerror or problem}")
            return
        if data:
            self._on_data(data)

    def _lose(self, why: str) -> None:
        link, self._link, self.is_new = self._link, None, False
        if link is not None:
            self._selector.unregister(link)
            link.close()
        self.outbox.clear()
        if link is not None and time.monotonic_ns() - self._opened_ns >= STABLE_NS:
            self._retry_ns = 0  # whether it can be opened again says more than why it was lost
            return
        self._retry_ns = time.monotonic_ns() + self._retries.next()
        self._on_status(why)


# --- guard --------------------------------------------------------------------------------------------

LINGER_NS = 2_000_000_000
"""Time without drivers after which the guard ends."""

GOODBYE_NS = 500_000_000
"""Time that the stops, and then the goodbye, may take at the end."""

SEND_NS = 100_000_000
"""Time in ns after which a stop or decision counts as not sent. Shorter than `line.ANSWER_S`."""

UNSENT_CHECK_NS = 2_000_000
"""Time in ns between two checks that it has been sent."""


@dataclass(slots=True)
class GuardedActuator:
    """What the guard knows of one actuator; `decided_ns` is its last decision, while it may move. Mutable."""

    stop: bytes
    goodbye: bytes = b""
    deadline_ns: int = 0
    handshake_first: bool = False
    decided_ns: int | None = None

    @property
    def due_ns(self) -> int | None:
        """Time at which the actuator is stopped unless there is another decision."""
        return None if self.decided_ns is None else self.decided_ns + self.deadline_ns


class Guard:
    """The guard, over its listening socket. Mutable; one thread."""

    def __init__(self, listener: socket.socket, port: str, baud: int, stop: bytes) -> None:
        self._selector = selectors.DefaultSelector()
        self._selector.register(listener, selectors.EVENT_READ, self._accept)
        self._listener = listener
        self._port = GuardedPort(port, baud, self._selector, self._on_data, self._on_status)
        self._status: bytes | None = None  # until the port was tried
        self._drivers: list[socket.socket] = []
        self._alone_since_ns = time.monotonic_ns()
        self._commanding: socket.socket | None = None
        self._channels = {0: GuardedActuator(stop)}  # of the connection that commands, or commanded last
        self._asked: list[
            tuple[int, int, int]
        ] = []  # channels and numbers of questions, and when they are due
        self.ending = False

    def run(self) -> None:
        """Guard until asked to end, until there was no driver for `LINGER_NS`, or until it fails."""
        try:
            while not self.ending:
                now_ns = time.monotonic_ns()
                if not self._drivers and now_ns - self._alone_since_ns >= LINGER_NS:
                    break
                for number, channel in self._channels.items():
                    if channel.due_ns is not None and now_ns >= channel.due_ns:
                        self._halt([number])
                self._port.do_what_is_due()
                self._answer()
                for key, _ in self._selector.select(max(0, self._due_ns() - time.monotonic_ns()) / 1e9):
                    key.data()
        finally:
            self._end()

    def watch_signals(self) -> None:
        """End at SIGTERM and SIGINT."""
        on_signals(self._selector, lambda: setattr(self, "ending", True))

    def _due_ns(self) -> int:
        alone_ns = None if self._drivers else self._alone_since_ns + LINGER_NS
        dead = (channel.due_ns for channel in self._channels.values())
        asked_ns = time.monotonic_ns() + UNSENT_CHECK_NS if self._asked else None
        due = (self._port.due_ns(), alone_ns, asked_ns, *dead)
        return min((t_ns for t_ns in due if t_ns is not None), default=time.monotonic_ns() + LINGER_NS)

    def _halt(self, numbers: Iterable[int] | None = None, *, drops_plain: bool = True) -> None:
        """Drop what waits and send the stops, of all channels or of these."""
        for number in self._channels if numbers is None else numbers:
            channel = self._channels[number]
            channel.decided_ns = None
            if self._port.is_open:  # else the stop comes when it opens
                now_ns = time.monotonic_ns()
                self._port.outbox.stop(channel.stop, now_ns, number, drops_plain=drops_plain)

    def _halt_unknown(self, numbers: Iterable[int] | None = None) -> None:
        """Stop actuators whose last command is unknown, unless the line has to hear the handshake first."""
        self._halt(numbers)
        if self._port.is_new and any(channel.handshake_first for channel in self._channels.values()):
            self._port.outbox.clear()

    def _answer(self) -> None:
        """Answer the questions whose stops or decisions were sent, or cannot be."""
        now_ns, asked, self._asked = time.monotonic_ns(), self._asked, []
        for channel, number, due_ns in asked:
            if (why := self._why_unsent(channel, is_due=now_ns >= due_ns)) is None:
                self._asked.append((channel, number, due_ns))
            elif self._commanding is not None:
                self._send(self._commanding, kinds.SENT + struct.pack("<I", number) + why.encode())

    def _why_unsent(self, channel: int, *, is_due: bool) -> str | None:
        """Return why a channel's newest stop or decision was not sent, "" if it was, None while it may be."""
        if not self._port.is_open:
            return "" if self._status is None else self._status[1:].decode()
        match self._port.is_sent(channel):
            case True:
                return ""
            case None:
                return "the device is being opened"
            case False:
                return f"{self._port.name} takes no bytes" if is_due else None

    def _end(self) -> None:
        """Stop, say goodbye, and release the port."""
        self._listener.close()
        self._halt()
        self._port.write_all(GOODBYE_NS)
        for goodbye in dict.fromkeys(
            channel.goodbye for channel in self._channels.values() if channel.goodbye
        ):
            self._port.outbox.add(goodbye)
        self._port.write_all(GOODBYE_NS)
        self._port.close()

    def _on_data(self, data: bytes) -> None:
        self._send_all(kinds.DATA + struct.pack("<Q", time.monotonic_ns()) + data)

    def _on_status(self, why_lost: str | None) -> None:
        """Tell all drivers and the log; a port that is open again may have a base that moves."""
        up, before = kinds.UP + str(self._port.baud).encode(), self._status
        self._status = up if why_lost is None else kinds.LOST + why_lost.encode()
        with suppress(OSError):  # a full disk must not end what stops the base
            if self._status != before:
                print(why_lost or f"{self._port.name} is open", flush=True)
        self._send_all(self._status)
        self._halt_unknown()

    # --- drivers -------------------------------------------------------------------------------------

    def _accept(self) -> None:
        with suppress(OSError):
            driver, _ = self._listener.accept()
            driver.setblocking(False)
            self._drivers.append(driver)
            self._selector.register(driver, selectors.EVENT_READ, lambda: self._receive(driver))
            if self._status is not None:
                self._send(driver, self._status)

    def _receive(self, driver: socket.socket) -> None:
        try:
            packet = driver.recv(kinds.MAX_PACKET_BYTES)
        except BlockingIOError:
            return
        except OSError:
            packet = b""
        kind, body = packet[:1], packet[1:]
        if not kind:
            self._drop(driver)
        elif kind == kinds.PLAIN:
            self._port.outbox.add(body)
        elif kind == kinds.HELLO and len(body) >= kinds.HELLO_HEAD.size:
            self._greet(driver, body)
        elif driver is self._commanding and kind == kinds.ASK and len(body) == kinds.ASK_BODY.size:
            channel, number, stops = kinds.ASK_BODY.unpack(body)
            if channel not in self._channels:
                return
            if stops:
                self._halt([channel], drops_plain=False)  # the last settings of its opening may wait
            self._asked.append((channel, number, time.monotonic_ns() + SEND_NS))
        elif driver is self._commanding and kind == kinds.DECIDED and len(body) > kinds.DECIDED_HEAD.size:
            channel, decided_ns = kinds.DECIDED_HEAD.unpack_from(body)
            self._decide(channel, decided_ns, body[kinds.DECIDED_HEAD.size :])

    def _greet(self, driver: socket.socket, body: bytes) -> None:
        if self._commanding not in (None, driver):
            why = f"another driver commands {self._port.name} already; end it first"
            self._send(driver, kinds.REFUSED + why.encode())
            self._drop(driver)
            return
        if self._commanding is None:
            self._commanding, self._channels = driver, {}
        number, deadline_ms, handshake_first, size = kinds.HELLO_HEAD.unpack_from(body)
        body = body[kinds.HELLO_HEAD.size :]
        self._channels[number] = GuardedActuator(
            body[:size], body[size:], deadline_ms * 1_000_000, handshake_first
        )
        self._halt_unknown([number])

    def _decide(self, number: int, decided_ns: int, data: bytes) -> None:
        now_ns, channel = time.monotonic_ns(), self._channels.get(number)
        if self._port.is_open and channel is not None and now_ns - decided_ns < channel.deadline_ns:
            channel.decided_ns = min(decided_ns, now_ns)
            self._port.outbox.decide(data, number)

    def _drop(self, driver: socket.socket) -> None:
        if driver not in self._drivers:
            return
        self._drivers.remove(driver)
        self._selector.unregister(driver)
        driver.close()
        self._alone_since_ns = time.monotonic_ns()
        if driver is self._commanding:
            self._commanding, self._asked = None, []
            self._halt()

    def _send_all(self, packet: bytes) -> None:
        for driver in tuple(self._drivers):
            self._send(driver, packet)

    def _send(self, driver: socket.socket, packet: bytes) -> None:
        try:
            driver.send(packet)
        except BlockingIOError:
            pass  # a driver that does not read misses this; its decoder gets in step again
        except OSError:
            self._drop(driver)


def main() -> None:
    """Run the guard of `SOCKET PORT BAUD STOP`, the stop in hexadecimal, unless the port has one."""
    path, port, baud, stop = sys.argv[1:]
    if (listener := claimed(path)) is None:
        return
    guard = Guard(listener, port, int(baud), bytes.fromhex(stop))
    guard.watch_signals()
    try:
        guard.run()
    finally:
        Path(path).unlink(missing_ok=True)


if __name__ == "__main__":
    main()
