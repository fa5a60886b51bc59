"""Ctrl-C in a run: the first ends the run gracefully, the second immediately. Threads for a part of a run."""

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
def interruptible(message: str = "stopping after this frame") -> Iterator[Callable[[], bool]]:
    """Catch the first Ctrl-C, so that a run can end between two frames.

    SIGTERM and the closing of the terminal count as well. The second one raises KeyboardInterrupt
    immediately. The context's value is a function that returns True after the first. `message` is shown
    if the shutdown takes long.
    """
    signaled: list[int] = []
    reminder = threading.Timer(PROGRESS_DELAY_S, say, (f"{message}; press Ctrl-C again to stop immediately",))
    reminder.daemon = True
    if threading.current_thread() is not threading.main_thread():
        yield lambda: bool(signaled)
        return

    def on_signal(number: int, _: object) -> None:
        if signaled:
            raise KeyboardInterrupt
        signaled.append(number)
        reminder.start()

    previous_handlers = {number: signal.signal(number, on_signal) for number in termination_signals()}
    try:
        yield lambda: bool(signaled)
    finally:
        reminder.cancel()
        for number, handler in previous_handlers.items():
            signal.signal(number, handler)


@contextmanager
def in_thread(
    name: str, run: Callable[[], object], stop: Callable[[], object]
) -> Iterator[list[BaseException]]:
    """Call `run` in a thread inside the `with`; at its end call `stop`, and wait until `run` has returned.

    The list gets the exception that ended it.
    """
    failed: list[BaseException] = []

    def call() -> None:
        try:
            run()
        except BaseException as failure:
            failed.append(failure)

    thread = threading.Thread(target=call, name=name)
    thread.start()
    try:
        yield failed
    finally:
        stop()
        thread.join()
