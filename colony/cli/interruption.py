"""Ctrl-C in a run: the first one ends it in order, the next one at once."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from colony.cli.reporting import PATIENCE_S, say


def signals_that_end() -> tuple[signal.Signals, ...]:
    """SIGINT and SIGTERM, and SIGHUP unless who started the process wants it to outlive the terminal."""
    hangup = () if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else (signal.SIGHUP,)
    return (signal.SIGINT, signal.SIGTERM, *hangup)


@contextmanager
def interruptible(ending: str = "stopping after this frame") -> Iterator[Callable[[], bool]]:
    """While it lasts, the first Ctrl-C (or SIGTERM, or the end of the terminal) is noted, for the run to end
    between two moments; the next one breaks in at once. Gives the function that tells whether there was one.
    `ending` is what is said where it takes long.
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
