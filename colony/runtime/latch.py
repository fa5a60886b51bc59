"""The emergency stop, remembered: it stays on through a restart of the server, until it is released.

It is kept in a small file, replaced as a whole. A file that cannot be read counts as a stop: a robot that may
have been stopped for a reason does not drive on because of a bad disk.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from colony.runtime.library.robot import Stopped


class StopLatch:
    """Mutable: whether the stop is on, and whether the file says so.

    Args:
        path: the file, which need not be there; None: a restart forgets the stop.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._saved = True
        self.trouble: str | None = None
        self.stopped = None if path is None else self._load(path)

    def engage(self, by: str, now_ns: int) -> None:
        """Stop; who stopped first stays the one who did."""
        if self.stopped is None:
            self.stopped = Stopped(by=by, t_ns=now_ns)
            self._saved = False
        self.save()

    def release(self) -> None:
        """Go on."""
        if self.stopped is not None:
            self.stopped = None
            self._saved = False
        self.save()

    def save(self) -> None:
        """Write the file where it is not as it should be; what is in the way of that is `trouble`."""
        if self._saved or self._path is None:
            return
        try:
            _replace(self._path, msgspec.json.encode(self.stopped))
        except OSError as problem:
            self.trouble = f"{self._path}: {problem.strerror or problem}"
            return
        self._saved, self.trouble = True, None

    def _load(self, path: Path) -> Stopped | None:
        try:
            return msgspec.json.decode(path.read_bytes(), type=Stopped | None)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.DecodeError, UnicodeDecodeError) as problem:
            self.trouble = f"{path}: {problem}"
            return Stopped(by="a file that cannot be read", t_ns=0)


def _replace(path: Path, data: bytes) -> None:
    """Write a file so that after a crash it is the old one or the new one."""
    beside = path.with_name(f"{path.name}.new")
    with open(beside, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)
    directory = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
