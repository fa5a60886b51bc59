"""When a process of a robot has to end: it was told to by a signal, or its parent is gone.

The parent holds the other end of the standard input. However the parent ends, also by SIGKILL, the kernel
closes that, and reading gives its end: so nothing is left behind of a run that was killed.
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
"""For how long a process may close what it holds before it is ended the hard way."""

EXIT_FAILED = 1
"""Exit code of a process that cannot go on: another one in its place may."""

EXIT_FINAL = 2
"""Exit code of a process that was started wrongly: starting it again would not help."""

EXIT_HARD = 70
"""Exit code of a process that did not close in time."""


PARENT_GONE = "the process that started it is gone"


class Ending:
    """Tells when to end. Mutable: why, and what is to be done then.

    `note` may be called from any thread, and again; only the first reason counts. From then on the process
    has `PATIENCE_S` to close what it holds, and ends in any case.
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
        """Kill this process with all that it forked, if its parent is gone, which would do that otherwise."""
        if self.why == PARENT_GONE and os.getpgrp() == os.getpid():
            kill_group(os.getpid())

    def then(self, stop: Callable[[], None]) -> None:
        """Call `stop` when it is time, at once if it is already."""
        self._then = stop
        if self.why is not None:
            stop()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Whether the time has come, after waiting for it for so long at most."""
        return self._event.wait(timeout_s)

    def __bool__(self) -> bool:
        return self.why is not None


@contextmanager
def on_signals(ending: Ending) -> Iterator[None]:
    """While it lasts, end on SIGINT, SIGTERM and SIGHUP; to be used in the main thread.

    A thread of its own is told of them, through a pipe: a handler in Python would wait for the main thread,
    and could break in where that holds a lock which it needs.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)

    def watch() -> None:
        while number := os.read(reading, 1):
            if number[0] in SIGNALS:  # the pipe is told of every signal that has a handler
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
    """Kill all processes of a group, where there are any."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(leader, signal.SIGKILL)


class _Log(io.FileIO):
    """What a process prints into. What cannot be written, because the disk is full for one, is dropped:
    nobody stops moving a robot over a line in a log."""

    def write(self, data: Buffer, /) -> int:
        with suppress(OSError):
            return super().write(data)
        return memoryview(data).nbytes


def drop_what_cannot_be_printed() -> None:
    """Let nothing that this process prints, modules in Python included, fail from now on."""
    for name, descriptor in (("stdout", 1), ("stderr", 2)):
        log = cast(BinaryIO, _Log(descriptor, "wb", closefd=False))
        stream = io.TextIOWrapper(log, encoding="utf-8", errors="backslashreplace", write_through=True)
        setattr(sys, name, stream)


def say(text: str) -> None:
    """A line for whoever started the process; it goes into its log. Where that is full, it is dropped."""
    with suppress(OSError):
        print(text, file=sys.stderr, flush=True)


def give_up(text: str, code: int = EXIT_FINAL) -> NoReturn:
    """Say why the process ends, and end: it was started wrongly, unless another code says otherwise."""
    say(text)
    sys.exit(code)


def give_up_without(problem: Exception) -> NoReturn:
    """End for lack of memory, files or room, and say so in a line; raise anything else, which is a bug."""
    if is_out_of_memory(problem):
        give_up("out of memory", EXIT_FAILED)
    if isinstance(problem, OSError):
        give_up(described(problem), EXIT_FAILED)
    raise problem
