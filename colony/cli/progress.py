"""Progress of a command that reads a large file."""

from __future__ import annotations

import os
import time
from typing import BinaryIO

from colony.cli.reporting import PROGRESS_DELAY_S, say


class ReadingProgress:
    """Reports each tenth of a file that is read, if reading takes long. Stateful."""

    def __init__(self, file: BinaryIO, label: str = "") -> None:
        self._file, self._label = file, label
        self._size = os.fstat(file.fileno()).st_size
        self._since = time.monotonic()
        self._tenths = 0

    def __call__(self) -> None:
        """Report the progress, if it has reached another tenth."""
        tenths = 10 * self._file.tell() // max(self._size, 1)
        if tenths > self._tenths:
            self._tenths = tenths
            if tenths < 10 and time.monotonic() - self._since > PROGRESS_DELAY_S:
                say(f"{self._label}{10 * tenths} %")
