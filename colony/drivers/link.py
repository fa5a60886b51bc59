"""Byte links: a serial port or a TCP connection, opened from a text, without waiting for bytes.

    /dev/ttyUSB0, /dev/pts/4      a serial port (8N1, no flow control), or the end of a pseudoterminal
    tcp:HOST:PORT                 a simulator, or a server of serial ports

A serial port is opened exclusively, so that a second program cannot drive the same robot by accident.
"""

from __future__ import annotations

import errno
import fcntl
import os
import socket
import stat
import sys
import termios
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Protocol

TCP = "tcp:"
"""Prefix of a link over TCP."""

CONNECT_S = 2.0
"""Seconds that a TCP connection may take."""

UDEV_RULE = "a rule of udev (docs/drivers.md)"

READ_BYTES = 4096
"""Maximum number of bytes of one read."""


class ByteLink(Protocol):
    """An open byte link. No method waits. Each raises an OSError once the link is lost."""

    def read(self) -> bytes:
        """Return the bytes that have arrived; none if there are none."""
        ...

    def write(self, data: bytes) -> int:
        """Send bytes, and return how many of them were taken: fewer than all if there is no room."""
        ...

    def unsent(self) -> int:
        """Return the number of bytes that were taken and have not left this computer."""
        ...

    def fileno(self) -> int:
        """Return the descriptor, readable when bytes have arrived or the link is lost."""
        ...

    def close(self) -> None:
        """Release the link. Idempotent."""
        ...


class LinkError(OSError):
    """A link cannot be opened; the text says why, and what to do."""


def open_link(text: str, baud: int) -> ByteLink:
    """Open a link.

    Args:
        text: what to open, as this module says.
        baud: the baud rate of a serial port; 0 leaves it as it is.

    Raises:
        LinkError: it cannot be opened.
    """
    return _tcp(text) if text.startswith(TCP) else _serial(text, baud)


class _Descriptor:
    """A link over a descriptor that does not block. Mutable: may be closed."""

    def __init__(self, owner: socket.socket | object, descriptor: int) -> None:
        self._owner = owner  # closes the descriptor
        self._descriptor = descriptor

    def read(self) -> bytes:
        try:
            data = os.read(self._descriptor, READ_BYTES)
        except BlockingIOError:
            return b""
        if not data:
            raise ConnectionResetError(errno.ECONNRESET, "the other end is closed")
        return data

    def write(self, data: bytes) -> int:
        try:
            return os.write(self._descriptor, data)
        except BlockingIOError:
            return 0

    def unsent(self) -> int:
        found = fcntl.ioctl(self._descriptor, termios.TIOCOUTQ, bytes(4))
        return int.from_bytes(found, sys.byteorder)

    def fileno(self) -> int:
        return self._descriptor

    def close(self) -> None:
        with suppress(OSError):
            self._owner.close()  # type: ignore[union-attr]


def _tcp(text: str) -> ByteLink:
    host, _, port = text.removeprefix(TCP).rpartition(":")
    is_port = port.isdecimal() and len(port) < 6 and 0 < int(port) < 65_536
    if not host or not is_port:
        raise LinkError(f"{text} is no link: write tcp:HOST:PORT, for example tcp:localhost:8101")
    try:
        connection = socket.create_connection((host.strip("[]"), int(port)), CONNECT_S)
    except (OSError, UnicodeError) as problem:  # the latter for what no host can be called
        why = getattr(problem, "strerror", None) or str(problem)
        raise LinkError(f"{text}: {why}: does the simulator run, and listen on this port?") from None
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setblocking(False)
    return _Descriptor(connection, connection.fileno())


def _serial(path: str, baud: int) -> ByteLink:
    _check_kind(path)
    try:
        import serial  # type: ignore[import-untyped]  # of the extra `drivers`
    except ModuleNotFoundError:
        raise LinkError("pyserial is not installed; run: pip install 'colony-robotics[drivers]'") from None
    rate = {"baudrate": baud} if baud else {}
    try:
        port = serial.Serial(path, **rate, timeout=0, write_timeout=0, exclusive=True)
        fcntl.ioctl(port.fd, termios.TIOCEXCL)  # so that programs that take no lock cannot open it either
        settings = termios.tcgetattr(port.fd)
        settings[6][termios.VMIN] = 1  # so that no bytes and a pulled cable are not the same
        termios.tcsetattr(port.fd, termios.TCSANOW, settings)
    except (OSError, ValueError, OverflowError, termios.error) as problem:
        raise LinkError(_why_not(path, problem)) from None
    return _Descriptor(port, port.fd)


def _check_kind(path: str) -> None:
    try:
        mode = os.stat(path).st_mode
    except OSError as problem:
        raise LinkError(_why_not(path, problem)) from None
    if not stat.S_ISCHR(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "no device"
        raise LinkError(f"{path} is {kind}; expected a serial port. {_existing()}")


def _why_not(path: str, problem: Exception) -> str:
    """Return why a serial port cannot be opened, and what to do."""
    number = getattr(problem, "errno", None)
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return f"there is no port {path}: is its cable plugged in? {_existing()}"
    if number in (errno.EACCES, errno.EPERM):
        return f"{path} may not be opened by this user: {_permission_advice(path)}"
    if number in (errno.EBUSY, errno.EAGAIN):
        return f"{path} is busy: {_holder_advice(path)}"
    if number in (errno.ENOTTY, errno.EINVAL) or number is None:
        return f"{path} is no serial port, or does not take these settings ({problem}). {_existing()}"
    return f"{path}: {os.strerror(number)}"


def _permission_advice(path: str) -> str:
    name = _group(path)
    if name is None:
        return f"it belongs to no group that you can join: give it `dialout` by {UDEV_RULE}"
    return f"add yourself to the port's group, `sudo usermod -aG {name} $USER`, and log in again"


def _group(path: str) -> str | None:
    import grp

    with suppress(OSError, KeyError):
        if group := os.stat(path).st_gid:
            return grp.getgrgid(group).gr_name
    return None


def _holder_advice(path: str) -> str:
    holder = next(_holders(path), None)
    if holder is None:
        return f"a process of another user holds it, which `sudo fuser -v {path}` names; end it first"
    advice = f"; keep it away by {UDEV_RULE}" if "ModemManager" in holder else ""
    return f"{holder} holds it; end it first{advice}"


def _existing() -> str:
    names = ("ttyUSB*", "ttyACM*", "ttyAMA*", "rfcomm*", "serial/by-id/*")
    ports = sorted(str(port) for name in names for port in Path("/dev").glob(name))
    return f"Ports that exist: {', '.join(ports)}" if ports else "No USB serial port exists"


def _holders(path: str) -> Iterator[str]:
    """Yield the processes that have a port open, as far as this user can see."""
    target = os.path.realpath(path)
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if any(os.path.realpath(fd) == target for fd in (folder / "fd").iterdir()):
                yield f"process {folder.name} ({(folder / 'comm').read_text().strip()})"
