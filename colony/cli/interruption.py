"""Ctrl-C in a run: the first one ends it gracefully, the next one immediately."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from colony.cli.reporting import PROGRESS_DELAY_S, say


def termination_signals() -> tuple[signal.Signals, ...]:
    """Return SIGINT and SIGTERM, and SIGHUP unless the process was started to ignore it."""
    hangup = () if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else (signal.SIGHUP,)
    return (signal.SIGINT, signal.SIGTERM, *hangup)


@contextmanager
def interruptible(ending: str = "stopping after this frame") -> Iterator[Callable[[], bool]]:
    """Catch the first Ctrl-C, so that a run can end between two frames.

    SIGTERM and the end of the terminal count as well. The next one raises KeyboardInterrupt immediately. The
    context's value is a function that returns True after the first one. `ending` is the message for a slow
    shutdown.
    """
    signaled: list[int] = []
    reminder = threading.Timer(PROGRESS_DELAY_S, say, (f"{ending}; press Ctrl-C again to stop immediately",))
    reminder.daemon = True
    if threading.current_thread() is not threading.main_thread():
        yield lambda: bool(signaled)
        return

    def on_signal(number: int, _: object) -> None:
        if signaled:
            raise KeyboardInterrupt
        signaled.append(number)
        reminder.start()

    before = {number: signal.signal(number, on_signal) for number in termination_signals()}
    try:
        yield lambda: bool(signaled)
    finally:
        reminder.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)
