"""Handling of Ctrl-C while z3 runs."""

from __future__ import annotations

import ctypes
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from typing import TYPE_CHECKING

from colony.extras import installed

if TYPE_CHECKING:
    from sys import UnraisableHookArgs
    from types import FrameType

    import z3

_RESEND_DELAY_S = 0.01
"""Seconds before a lost Ctrl-C is sent again, by when Python has left the code that swallowed it."""

_INTERRUPT_INTERVAL_S = 0.05
"""Seconds between two interrupts of z3: one that comes before z3 has begun is lost."""


_CONTEXTS: list[z3.Context] = []
"""Contexts that Ctrl-C interrupts in place of z3's main one: what is interrupted while idle fails later."""


@contextmanager
def interruptible(context: z3.Context) -> Iterator[None]:
    """Have Ctrl-C interrupt this context of z3, which is at work, within `reliable_interrupts`."""
    _CONTEXTS.append(context)
    try:
        yield
    finally:
        _CONTEXTS.remove(context)


class _InterruptResender:
    """Sends a lost Ctrl-C again. Mutable.

    Python prints and drops a KeyboardInterrupt that is raised in a callback from C or while an object is
    deleted; no code can catch it.
    """

    def __init__(self) -> None:
        self._previous_hook = sys.unraisablehook
        self._timer: threading.Timer | None = None
        self._is_pending = False

    def hook(self, lost: UnraisableHookArgs) -> None:
        """Stand in for `sys.unraisablehook`."""
        if _is_half_made(lost):
            return
        if not _is_interrupt(lost.exc_value):
            self._previous_hook(lost)
            return
        self._is_pending = True
        self._timer = threading.Timer(_RESEND_DELAY_S, self._send)
        self._timer.daemon = True
        self._timer.start()

    def close(self) -> bool:
        """Stop sending; return True if a lost Ctrl-C is still to be sent."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer.join()
        return self._is_pending

    def _send(self) -> None:
        self._is_pending = False
        signal.raise_signal(signal.SIGINT)


def _is_interrupt(problem: BaseException | None) -> bool:
    """Return True for Ctrl-C, also for one that came while ctypes converted an argument for z3.

    ctypes raises that one as an ArgumentError, which names it in its text alone. z3, interrupted between two
    queries, raises "canceled" with the next call.
    """
    if isinstance(problem, ctypes.ArgumentError):
        return KeyboardInterrupt.__name__ in str(problem)
    if type(problem).__name__ == "Z3Exception":
        return "canceled" in str(problem)
    return isinstance(problem, KeyboardInterrupt)


def _is_half_made(lost: UnraisableHookArgs) -> bool:
    """Return True for the deletion of an object of z3 whose making Ctrl-C ended: it lacks its fields."""
    return isinstance(lost.exc_value, AttributeError) and getattr(lost.object, "__module__", "") == "z3.z3"


@contextmanager
def _z3_interruptible() -> Iterator[threading.Event]:
    """Interrupt z3 on SIGINT, in place of z3's own handler; the value is set once that has begun.

    z3 replaces the handler of SIGINT during a check, and loses a Ctrl-C that arrives as the check ends.
    Python's handler loses none, but cannot run before the check ends. So the signal wakes a thread, which
    interrupts z3 until that handler has run.
    """
    import z3

    receiver, sender = socket.socketpair()
    sender.setblocking(False)
    begun, handled, is_over = threading.Event(), threading.Event(), threading.Event()
    previous_handler = signal.getsignal(signal.SIGINT)

    def handle(signal_number: int, frame: FrameType | None) -> None:
        handled.set()
        if callable(previous_handler):
            previous_handler(signal_number, frame)

    def watch() -> None:
        while signal_byte := receiver.recv(1):
            while signal_byte[0] == signal.SIGINT and not (
                is_over.is_set() or handled.wait(_INTERRUPT_INTERVAL_S)
            ):
                for context in _CONTEXTS or [z3.main_ctx()]:
                    begun.set()
                    with suppress(z3.Z3Exception):  # "canceled", of an earlier interrupt that took hold
                        context.interrupt()
            handled.clear()

    watcher = threading.Thread(target=watch, daemon=True)
    with ExitStack() as cleanup:  # even a Ctrl-C during setup or cleanup leaves nothing open
        cleanup.enter_context(receiver)
        watcher.start()
        cleanup.callback(watcher.join)
        cleanup.enter_context(sender)
        cleanup.callback(is_over.set)
        z3.set_param("ctrl_c", False)
        cleanup.callback(z3.set_param, "ctrl_c", True)
        signal.signal(signal.SIGINT, handle)
        cleanup.callback(signal.signal, signal.SIGINT, previous_handler)
        fd = signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
        cleanup.callback(signal.set_wakeup_fd, fd)
        yield begun


@contextmanager
def reliable_interrupts() -> Iterator[None]:
    """Turn every Ctrl-C into a KeyboardInterrupt in the main thread, if need be with a short delay.

    ctypes and z3 raise exceptions of their own in its place; see `_is_interrupt`.
    """
    previous_hook, resender = sys.unraisablehook, _InterruptResender()
    sys.unraisablehook = resender.hook
    begun = threading.Event()
    try:
        with _z3_interruptible() if installed("z3") else nullcontext(begun) as begun:
            yield
    except KeyboardInterrupt as problem:
        traceback.clear_frames(problem.__traceback__)  # what is half made is deleted while the hook is ours
        raise
    except Exception as problem:
        if not (_is_interrupt(problem) and (begun.is_set() or isinstance(problem, ctypes.ArgumentError))):
            raise
        raise KeyboardInterrupt from None
    finally:
        sys.unraisablehook = previous_hook
        lost = resender.close()
    if lost:
        raise KeyboardInterrupt
