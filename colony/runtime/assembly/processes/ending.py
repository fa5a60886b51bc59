"""The end of a robot's process: on a signal, or when its parent is gone.

The parent holds the other end of the standard input. However the parent ends, even by SIGKILL, the kernel
closes that end, and reading reaches the end of file: a killed run leaves nothing behind.
"""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, BinaryIO, NoReturn, cast

from colony.os_errors import described, is_out_of_memory

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer as Buffer

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

PATIENCE_S = 1.5
"""Grace period in seconds to close resources before the process ends forcibly."""

EXIT_FAILED = 1
"""Exit code of a process that cannot go on; a restart may succeed."""

EXIT_FINAL = 2
"""Exit code of a process that was started wrongly; a restart would not help."""

EXIT_HARD = 70
"""Exit code of a process that did not close in time."""


PARENT_GONE = "the process that started it is gone"


class Ending:
    """The decision to end a process. Mutable: the reason, and the action to take.

    `note` may be called repeatedly and from any thread; only the first reason counts. From then on the
    process has `PATIENCE_S` to close its resources, and ends in any case.
    """

    def __init__(self) -> None:
        self._event = threading.Event()
        self._then: Callable[[], None] = lambda: None
        self.why: str | None = None

    def note(self, why: str) -> None:
        """Begin to end, for this reason."""
        if self.why is not None:
            return
        self.why = why
        timer = threading.Timer(PATIENCE_S, self._end_hard)
        timer.daemon = True
        timer.start()
        self._event.set()
        self._then()

    def _end_hard(self) -> None:
        self.end_forked()
        os._exit(EXIT_HARD)

    def end_forked(self) -> None:
        """Kill this process and all that it forked if its parent, which would do that otherwise, is gone."""
        if self.why == PARENT_GONE and os.getpgrp() == os.getpid():
            kill_group(os.getpid())

    def then(self, stop: Callable[[], None]) -> None:
        """Call `stop` when it is time to end, immediately if it is already."""
        self._then = stop
        if self.why is not None:
            stop()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait for the time to end, at most for `timeout_s`; return True if it has come."""
        return self._event.wait(timeout_s)

    def __bool__(self) -> bool:
        """Return True once the process has to end."""
        return self.why is not None


@contextmanager
def on_signals(ending: Ending) -> Iterator[None]:
    """End on SIGINT, SIGTERM and SIGHUP for the duration of a `with`; only for the main thread.

    A separate thread receives the signals through a pipe: a Python handler would wait for the main thread,
    and could interrupt it while it holds a lock that the handler needs.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)

    def watch() -> None:
        while number := os.read(reading, 1):
            if number[0] in SIGNALS:  # the pipe receives every signal that has a handler
                ending.note(signal.Signals(number[0]).name)
        os.close(reading)

    threading.Thread(target=watch, name="signals", daemon=True).start()
    before_fd = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    before = {number: signal.signal(number, lambda *_: None) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(before_fd)
        os.close(writing)


def on_death_of_parent(ending: Ending) -> None:
    """End when the standard input does."""

    def watch() -> None:
        try:
            while os.read(sys.stdin.fileno(), 4096):
                pass
        except (OSError, ValueError):
            pass
        ending.note(PARENT_GONE)

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


def drop_what_cannot_be_printed() -> None:
    """Make every print of this process safe from failure, including those of Python modules."""
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        log = cast(BinaryIO, _Log(descriptor, "wb", closefd=False))
        stream = io.TextIOWrapper(log, encoding="utf-8", errors="backslashreplace", write_through=True)
        setattr(sys, name, stream)


def say(text: str) -> None:
    """Print a line to standard error, the log of a child process; drop it if the log is full."""
    with suppress(OSError):
        print(text, file=sys.stderr, flush=True)


def give_up(text: str, code: int = EXIT_FINAL) -> NoReturn:
    """Print why the process ends, and exit; by default as started wrongly."""
    say(text)
    sys.exit(code)


def give_up_without(problem: Exception) -> NoReturn:
    """Exit with one line on a lack of memory, files or disk space; raise anything else, which is a bug."""
    if is_out_of_memory(problem):
        give_up("out of memory", EXIT_FAILED)
    if isinstance(problem, OSError):
        give_up(described(problem), EXIT_FAILED)
    raise problem
