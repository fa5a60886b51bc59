"""The shutdown of a robot's process: on a signal, or when its parent ends.

The parent holds the other end of the standard input pipe. However the parent ends, even by SIGKILL, the
kernel closes that pipe, and the process reads an end of file: a killed run leaves no processes behind.
"""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from typing import TYPE_CHECKING, BinaryIO, NoReturn, cast

from colony.files import describe, is_out_of_memory
from colony.runtime.observe.closing import repeating

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer as Buffer


# --- stalls --------------------------------------------------------------------------------------------
#
# A thread that notices when its process stands still: frozen, starved, or held by code that never yields.
#
# Python runs one thread at a time. Code that keeps the interpreter for itself, such as a driver in C, stops
# all servers of a process, also their emergency stops; a base then stands by its own watchdog or guard,
# because commands no longer arrive. Afterwards this thread says for how long it was.


INTERVAL_S = 0.1
"""Seconds between two looks."""

STALL_S = 0.25
"""Seconds of delay that are reported, several frames of most robots."""


QUIET_S = 30.0
"""Seconds after a report in which only a stall is reported that is longer."""


def reporting_stalls(report: Callable[[str], None]) -> AbstractContextManager[None]:
    """Return a context in which stalls of this process are reported, those of a busy machine now and then."""
    stalls, last = Stalls(), time.monotonic()

    def look() -> None:
        nonlocal last
        now = time.monotonic()
        if (text := stalls.after(now - last, now)) is not None:
            report(text)
        last = now

    return repeating("stalls", look, interval_s=INTERVAL_S)


class Stalls:
    """The stalls of a process. Stateful: remembers the one that was reported last."""

    def __init__(self) -> None:
        self._reported_s, self._quiet_until_s = 0.0, 0.0

    def after(self, waited_s: float, now_s: float) -> str | None:
        """Return what to report after a wait of `INTERVAL_S` that took so long; None if nothing is."""
        late_s = waited_s - INTERVAL_S
        if now_s >= self._quiet_until_s:
            self._reported_s = 0.0
        if late_s < max(STALL_S, self._reported_s):
            return None
        self._reported_s, self._quiet_until_s = late_s, now_s + QUIET_S
        return (
            f"this process stood still for {late_s:.2f} s: it was frozen, the machine is overloaded, or a "
            "driver holds the interpreter"
        )


# --- shutdown ------------------------------------------------------------------------------------------


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

CLOSE_GRACE_S = 1.5
"""Grace period in seconds to close resources before the process is terminated."""

EXIT_FAILED = 1
"""Exit code of a process that cannot continue; a restart may succeed."""

EXIT_FINAL = 2
"""Exit code of a process that was started wrongly; a restart would not help."""

EXIT_HARD = 70
"""Exit code of a process that did not close in time."""

PARENT_GONE = "the process that started it is gone"
"""Reason of a shutdown after the parent has ended."""


class Shutdown:
    """The request to end a process. Mutable.

    `request` may be called repeatedly and from any thread; only the first reason counts. From then on the
    process has `CLOSE_GRACE_S` to close its resources, and then ends in any case.
    """

    def __init__(self) -> None:
        self._event = threading.Event()
        self._on_request: Callable[[], None] = lambda: None
        self.reason: str | None = None

    def request(self, reason: str) -> None:
        """Begin the shutdown, for this reason."""
        if self.reason is not None:
            return
        self.reason = reason
        timer = threading.Timer(CLOSE_GRACE_S, self._end_hard)
        timer.daemon = True
        timer.start()
        self._event.set()
        self._on_request()

    def _end_hard(self) -> None:
        self.end_forked()
        os._exit(EXIT_HARD)

    def end_forked(self) -> None:
        """Kill this process and all that it forked, if its parent, which would otherwise do so, is gone."""
        if self.reason == PARENT_GONE and os.getpgrp() == os.getpid():
            kill_group(os.getpid())

    def on_request(self, stop: Callable[[], None]) -> None:
        """Call `stop` when the shutdown begins, or immediately if it has begun."""
        self._on_request = stop
        if self.reason is not None:
            stop()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the shutdown, at most for `timeout_s`; return True if it has begun."""
        return self._event.wait(timeout_s)

    def __bool__(self) -> bool:
        """Return True if the shutdown has begun."""
        return self.reason is not None


@contextmanager
def on_signals(shutdown: Shutdown) -> Iterator[None]:
    """Shut down on SIGINT, SIGTERM and SIGHUP for the duration of a `with`; only for the main thread.

    A separate thread receives the signals through a pipe: a Python handler would wait for the main thread,
    and could interrupt it while it holds a lock that the handler needs.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)

    def watch() -> None:
        while data := os.read(reading, 1):
            if data[0] in SIGNALS:  # the pipe receives every signal that has a handler
                shutdown.request(signal.Signals(data[0]).name)
        os.close(reading)

    threading.Thread(target=watch, name="signals", daemon=True).start()
    previous_fd = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    previous = {number: signal.signal(number, lambda *_: None) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(previous_fd)
        os.close(writing)


def on_parent_exit(shutdown: Shutdown) -> None:
    """Shut down when the standard input ends."""

    def watch() -> None:
        try:
            while os.read(sys.stdin.fileno(), 4096):
                pass
        except (OSError, ValueError):
            pass
        shutdown.request(PARENT_GONE)

    threading.Thread(target=watch, name="parent", daemon=True).start()


def kill_group(leader: int) -> None:
    """Kill all processes of a group, if there are any."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(leader, signal.SIGKILL)


class _Log(io.FileIO):
    """The output stream of a process. Output that cannot be written, as on a full disk, is dropped.

    A robot must not stop because of a line in a log.
    """

    def write(self, data: Buffer, /) -> int:
        with suppress(OSError):
            return super().write(data)
        return memoryview(data).nbytes


def make_printing_safe() -> None:
    """Make printing in this process never fail, even in Python modules."""
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        log = cast(BinaryIO, _Log(descriptor, "wb", closefd=False))
        stream = io.TextIOWrapper(log, encoding="utf-8", errors="backslashreplace", write_through=True)
        setattr(sys, name, stream)


def log_line(text: str) -> None:
    """Print a line to standard error, the log of a child process; drop it if the log is full."""
    with suppress(OSError):
        print(text, file=sys.stderr, flush=True)


def exit_with(text: str, code: int = EXIT_FINAL) -> NoReturn:
    """Print the reason why the process ends, and exit; by default with `EXIT_FINAL`."""
    log_line(text)
    sys.exit(code)


def exit_if_out_of_resources(problem: Exception) -> NoReturn:
    """Exit with one line if memory, files or disk space ran out; raise any other error, which is a bug."""
    if is_out_of_memory(problem):
        exit_with("out of memory", EXIT_FAILED)
    if isinstance(problem, OSError):
        exit_with(describe(problem), EXIT_FAILED)
    raise problem
