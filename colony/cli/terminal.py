"""Lines that a user enters at the terminal during a run, read without blocking."""

from __future__ import annotations

import os
import select
import termios
from contextlib import suppress
from typing import TextIO

from colony.nav.missions.elevator_calls import PollResult


class Terminal:
    """A `LineInput` that reads from a stream: a terminal or a pipe. Stateful: buffers unread input.

    From a pipe all lines count. From a terminal only those lines count that are typed after the question,
    while this process runs in the foreground.
    """

    def __init__(self, stream: TextIO | None) -> None:
        try:
            self._file = None if stream is None else stream.fileno()
        except (OSError, ValueError):
            self._file = None
        self._buffer = b""

    def discard(self) -> None:
        """Discard the input typed so far."""
        if self._file is None or not os.isatty(self._file) or self._is_in_background():
            return
        with suppress(termios.error):  # the terminal was closed
            termios.tcflush(self._file, termios.TCIFLUSH)
        self._buffer = b""

    def poll(self) -> PollResult:
        """Return "line" if there is another line, "end" at the end of input, else "nothing"."""
        while b"\n" not in self._buffer:
            if self._file is None:
                return "end"
            if self._is_in_background() or not select.select([self._file], [], [], 0.0)[0]:
                return "nothing"
            try:
                chunk = os.read(self._file, 4096)
            except OSError:
                chunk = b""
            if not chunk:
                self._file = None
            self._buffer += chunk
        self._buffer = self._buffer.partition(b"\n")[2]
        return "line"

    def _is_in_background(self) -> bool:
        """Return True if the process is in the background of its terminal, where access would suspend it."""
        try:
            return self._file is not None and os.tcgetpgrp(self._file) != os.getpgrp()
        except OSError:  # not a terminal, or not that of this process
            return False
