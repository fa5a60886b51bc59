"""Ctrl-C while z3's Python side is at work."""

from __future__ import annotations

import ctypes
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_AGAIN_S = 0.01
"""After that long Python has left what took a Ctrl-C for itself; if not, it is sent once more."""


class _Resent:
    """Ctrl-C, once more where it was lost. Mutable.

    A KeyboardInterrupt in a callback of C, or while an object is deleted, has nobody to go to: Python prints
    and forgets it.
    """

    def __init__(self) -> None:
        self._before = sys.unraisablehook
        self._timer: threading.Timer | None = None
        self._owed = False

    def hook(self, lost: UnraisableHookArgs) -> None:
        """What `sys.unraisablehook` does meanwhile."""
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            self._before(lost)
            return
        self._owed = True
        self._timer = threading.Timer(_AGAIN_S, self._send)
        self._timer.daemon = True
        self._timer.start()

    def close(self) -> bool:
        """Send nothing any more; whether one is still to come."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join()
        return self._owed

    def _send(self) -> None:
        self._owed = False
        signal.raise_signal(signal.SIGINT)


@contextmanager
def interruptions() -> Iterator[None]:
    """While it lasts, Ctrl-C is a KeyboardInterrupt wherever it comes, soon after where it cannot be at once.

    One that comes while ctypes converts an argument for z3 is raised by ctypes as an ArgumentError, which
    names it in its text alone.
    """
    before, resent = sys.unraisablehook, _Resent()
    sys.unraisablehook = resent.hook
    try:
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
