"""Ctrl-C in a run: the first one ends it in order, the next one immediately."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from colony.cli.reporting import PATIENCE_S, say


def signals_that_end() -> tuple[signal.Signals, ...]:
    """Return SIGINT and SIGTERM, and SIGHUP unless the process was started to ignore it."""
    hangup = () if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else (signal.SIGHUP,)
    return (signal.SIGINT, signal.SIGTERM, *hangup)


@contextmanager
def interruptible(ending: str = "stopping after this frame") -> Iterator[Callable[[], bool]]:
    """Catch the first Ctrl-C, so that a run can end between two moments.

    SIGTERM and the end of the terminal count as well. The next one raises KeyboardInterrupt immediately. The
    context's value is a function that returns True after the first one. `ending` is printed if the end takes
    long.
    """
    noted: list[int] = []
    reminder = threading.Timer(PATIENCE_S, say, (f"{ending}; Ctrl-C again stops at once",))
    reminder.daemon = True
    if threading.current_thread() is not threading.main_thread():
        yield lambda: bool(noted)
        return

    def note(number: int, _: object) -> None:
        if noted:
            raise KeyboardInterrupt
        noted.append(number)
        reminder.start()

    before = {number: signal.signal(number, note) for number in signals_that_end()}
    try:
        yield lambda: bool(noted)
    finally:
        reminder.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)
