"""What makes a process the guard of a port: a lock that it holds, the socket beside it, and its signals."""

from __future__ import annotations

import fcntl
import os
import selectors
import signal
import socket
from collections.abc import Callable
from contextlib import suppress


def claimed(path: str) -> socket.socket | None:
    """Return the listening socket at `path`; None if another process guards the port.

    The lock is `path` with `.lock`, and contains the process id.
    """
    lock = os.open(f"{path}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(lock)
        return None
    with suppress(OSError):  # where the disk is full, nobody learns the process id
        os.pwrite(lock, f"{os.getpid():<15}\n".encode(), 0)
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
