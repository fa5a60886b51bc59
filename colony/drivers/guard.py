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

import selectors
import socket
import struct
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from colony.drivers import guard_packets as kinds
from colony.drivers.guard_port import GuardedPort
from colony.drivers.guard_process import claimed, on_signals

LINGER_NS = 2_000_000_000
"""Time without drivers after which the guard ends."""

GOODBYE_NS = 500_000_000
"""Time that the stops, and then the goodbye, may take at the end."""

SEND_NS = 100_000_000
"""Time in ns after which a stop or decision counts as not sent. Shorter than `line.ANSWER_S`."""

UNSENT_CHECK_NS = 2_000_000
"""Time in ns between two checks that it has been sent."""


@dataclass(slots=True)
class Channel:
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
        self._channels = {0: Channel(stop)}  # of the connection that commands, or commanded last
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
        self._channels[number] = Channel(body[:size], body[size:], deadline_ms * 1_000_000, handshake_first)
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
