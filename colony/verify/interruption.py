"""Handling of Ctrl-C while z3 runs."""

from __future__ import annotations

import ctypes
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

from colony.extras import installed

if TYPE_CHECKING:
    from sys import UnraisableHookArgs
    from types import FrameType

_AGAIN_S = 0.01
"""Seconds before a lost Ctrl-C is sent again: by then Python has left the code that swallowed it."""

_INTERRUPT_INTERVAL_S = 0.05
"""Seconds between two requests to z3 to give up: a request before z3 has begun is lost."""


class _Resent:
    """Ctrl-C, sent again where it was lost. Mutable.

    No code can catch a KeyboardInterrupt in a callback of C, or while an object is deleted: Python prints it
    and drops it.
    """

    def __init__(self) -> None:
        self._before = sys.unraisablehook
        self._timer: threading.Timer | None = None
        self._owed = False

    def hook(self, lost: UnraisableHookArgs) -> None:
        """Stand in for `sys.unraisablehook`."""
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            self._before(lost)
            return
        self._owed = True
        self._timer = threading.Timer(_AGAIN_S, self._send)
        self._timer.daemon = True
        self._timer.start()

    def close(self) -> bool:
        """Send nothing any more; return True if one is still to come."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join()
        return self._owed

    def _send(self) -> None:
        self._owed = False
        signal.raise_signal(signal.SIGINT)


@contextmanager
def _z3_gives_up() -> Iterator[None]:
    """Have z3 leave SIGINT alone, and end its work when one comes.

    z3 replaces the handler of SIGINT while it answers a question, and forgets a Ctrl-C that comes just when
    it has the answer. Without its handler the signal stays with Python, whose own handler has to wait for
    the end of the question: so a thread, which the signal wakes, interrupts z3 until that handler has run.
    """
    import z3

    awake, wakes = socket.socketpair()
    wakes.setblocking(False)
    handled = threading.Event()
    before = signal.getsignal(signal.SIGINT)

    def handle(number: int, frame: FrameType | None) -> None:
        handled.set()
        if callable(before):
            before(number, frame)

    def watch() -> None:
        while number := awake.recv(1):
            while number[0] == signal.SIGINT and not handled.wait(_INTERRUPT_INTERVAL_S):
                z3.main_ctx().interrupt()
            handled.clear()

    watcher = threading.Thread(target=watch, daemon=True)
    z3.set_param("ctrl_c", False)
    signal.signal(signal.SIGINT, handle)
    fd = signal.set_wakeup_fd(wakes.fileno(), warn_on_full_buffer=False)
    watcher.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(fd)
        signal.signal(signal.SIGINT, before)
        z3.set_param("ctrl_c", True)
        handled.set()
        wakes.close()
        watcher.join()
        awake.close()


@contextmanager
def interruptions() -> Iterator[None]:
    """Make every Ctrl-C a KeyboardInterrupt in the main thread, soon after where it cannot be at once.

    One that comes while ctypes converts an argument for z3 is raised by ctypes as an ArgumentError, which
    names it in its text alone.
    """
    before, resent = sys.unraisablehook, _Resent()
    sys.unraisablehook = resent.hook
    try:
        with _z3_gives_up() if installed("z3") else nullcontext():
            yield
    except ctypes.ArgumentError as problem:
        if KeyboardInterrupt.__name__ not in str(problem):
            raise
        raise KeyboardInterrupt from None
    finally:
        sys.unraisablehook = before
        lost = resent.close()
    if lost:
        raise KeyboardInterrupt
