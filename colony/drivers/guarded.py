"""The connection of a driver to the guard of its port, which it starts if there is none."""

from __future__ import annotations

import os
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from colony.drivers.guard_packets import (
    ASK,
    ASK_BODY,
    DATA,
    DECIDED,
    DECIDED_HEAD,
    HELLO,
    HELLO_HEAD,
    LOST,
    MAX_PACKET_BYTES,
    PLAIN,
    REFUSED,
    SENT,
    UP,
)
from colony.drivers.link import TCP, LinkError
from colony.runtime.transport.live.run_directory import RunDirectory

START_S = 10.0
"""Seconds that a guard may take to start, on a loaded machine."""

START_AGAIN_S = 1.0
"""Seconds after which another guard is started, while the first does not listen."""

ENDED_S = 0.2
"""Seconds after which it is started if the first has ended: killed, or it found one that was ending."""

CONNECT_PAUSE_S = 0.02

KILL_S = 1.0
"""Seconds that a killed guard may take to end."""

_CREDENTIALS = struct.Struct("3i")
"""The process, user and group at the other end of a socket."""

_guards: list[subprocess.Popen[bytes]] = []
"""The guards that this process has started, which outlive it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardedCommand:
    """What a driver that commands leaves with the guard, for one actuator.

    Attributes:
        stop: what stops the actuator.
        goodbye: what ends the session.
        deadline_ns: time in ns without a decision after which the guard stops the actuator.
        handshake_first: whether a port that was just opened hears the driver before any stop.
    """

    stop: bytes
    goodbye: bytes
    deadline_ns: int
    handshake_first: bool = False


@dataclass(frozen=True, slots=True)
class Up:
    """The port is open, and its device may have restarted."""

    baud: int


@dataclass(frozen=True, slots=True)
class PortLost:
    """The port is not open; `why` says the reason, and what to do."""

    why: str


@dataclass(frozen=True, slots=True)
class Arrived:
    """Bytes that arrived from the port at `t_ns`, of `time.monotonic_ns`."""

    data: bytes
    t_ns: int


@dataclass(frozen=True, slots=True)
class SendOutcome:
    """The answer to the question with this number: why the newest stop or decision was not sent, or empty."""

    number: int
    why: str


Event = Up | PortLost | Arrived | SendOutcome


class GuardError(LinkError):
    """The guard has ended, or does not answer."""


class GuardConnection:
    """A connection to a guard. `receive` is called by one thread, all else by any. Mutable: may be closed."""

    def __init__(self, connection: socket.socket, port: str) -> None:
        self._socket, self._port = connection, port
        self._readable = select.poll()
        self._readable.register(connection, select.POLLIN)

    def receive(self, timeout_s: float) -> Event | None:
        """Wait for the next event; None if there is none in time.

        Raises:
            LinkError: the guard refuses this connection.
            GuardError: the guard has ended.
        """
        if not self._readable.poll(timeout_s * 1000):
            return None
        try:
            packet = self._socket.recv(MAX_PACKET_BYTES)
        except (
            ConnectionResetError
        ):  # the guard closed it before it had read all; what it sent is still there
            packet = self._socket.recv(MAX_PACKET_BYTES)
        kind, body = packet[:1], packet[1:]
        if kind == DATA:
            return Arrived(body[8:], struct.unpack_from("<Q", body)[0])
        if kind == UP:
            return Up(int(body))
        if kind == LOST:
            return PortLost(body.decode())
        if kind == REFUSED:
            raise LinkError(body.decode())
        if kind == SENT:
            return SendOutcome(struct.unpack_from("<I", body)[0], body[4:].decode())
        raise GuardError(f"the guard of {self._port} has ended")

    def greet(self, channel: int, command: GuardedCommand) -> None:
        """Command an actuator over this channel.

        Raises:
            OSError: the guard has ended, or does not read.
        """
        head = HELLO_HEAD.pack(
            channel, command.deadline_ns // 1_000_000, command.handshake_first, len(command.stop)
        )
        self._socket.send(HELLO + head + command.stop + command.goodbye, socket.MSG_DONTWAIT)

    def decide(self, data: bytes, decided_ns: int, channel: int = 0) -> None:
        """Have bytes sent that carry out a frame that was decided at `decided_ns`.

        Raises:
            OSError: the guard has ended, or does not read.
        """
        self._socket.send(DECIDED + DECIDED_HEAD.pack(channel, decided_ns) + data, socket.MSG_DONTWAIT)

    def send(self, data: bytes) -> None:
        """Have bytes of a handshake, a setting or a query sent.

        Raises:
            OSError: the guard has ended, or does not read.
        """
        self._socket.send(PLAIN + data, socket.MSG_DONTWAIT)

    def ask_sent(self, number: int, channel: int = 0, *, stops: bool) -> None:
        """Have the stop of a channel sent if it `stops`, and ask whether its newest stop or decision was.

        `SendOutcome` answers.

        Raises:
            OSError: the guard has ended, or does not read.
        """
        self._socket.send(ASK + ASK_BODY.pack(channel, number, stops), socket.MSG_DONTWAIT)

    def kill_guard(self) -> None:
        """Kill the guard, which may be frozen, and wait until its lock and its port are free."""
        credentials = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        with suppress(OSError):  # it has just ended
            process = os.pidfd_open(_CREDENTIALS.unpack(credentials)[0])
            try:
                signal.pidfd_send_signal(process, signal.SIGKILL)
                select.select([process], [], [], KILL_S)
            finally:
                os.close(process)

    def close(self) -> None:
        """End the connection; if it commands, the guard stops the base. Idempotent."""
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # wakes a thread in `receive`
        self._socket.close()


def connect(port: str, baud: int, stop: bytes, *commands: GuardedCommand) -> GuardConnection:
    """Connect to the guard of a port; start it if there is none.

    Args:
        port: what `link.open_link` opens.
        baud: the baud rate of the port.
        stop: what a guard that is started here sends first, as the base may still drive.
        commands: what a driver that commands leaves with the guard, by channel; none only to listen.

    Raises:
        LinkError: the guard does not start.
        RunDirectoryError: the folder of its socket cannot be used.
    """
    port = port if port.startswith(TCP) else os.path.abspath(port)
    path = RunDirectory.find(os.environ).guard(port)
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        _reach(connection, path, port, baud, stop)
        guarded = GuardConnection(connection, port)
        for channel, command in enumerate(commands):
            with suppress(ConnectionError):  # a guard that refuses the first: `receive` says why
                guarded.greet(channel, command)
    except BaseException:
        connection.close()
        raise
    return guarded


def _reach(connection: socket.socket, path: Path, port: str, baud: int, stop: bytes) -> None:
    began = started = start_due = time.monotonic()
    guard: subprocess.Popen[bytes] | None = None  # the newest that was started
    while (now := time.monotonic()) < began + START_S:
        try:
            connection.connect(os.fspath(path))
        except (FileNotFoundError, ConnectionRefusedError):
            if guard is not None and guard.poll() is not None:
                start_due = min(start_due, started + ENDED_S)
            if now >= start_due:
                started, start_due = now, now + START_AGAIN_S
                _guards[:] = [other for other in _guards if other.poll() is None]
                _guards.append(guard := _start(path, port, baud, stop))
            time.sleep(CONNECT_PAUSE_S)
        else:
            return
    raise LinkError(f"the guard of {port} does not start; its log is {path}.log")


def _start(path: Path, port: str, baud: int, stop: bytes) -> subprocess.Popen[bytes]:
    """Start a guard in a session of its own, so that no signal to a group of processes reaches it."""
    log = os.open(f"{path}.log", os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
    try:
        return subprocess.Popen(
            [sys.executable, "-m", "colony.drivers.guard", os.fspath(path), port, str(baud), stop.hex()],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
    finally:
        os.close(log)
