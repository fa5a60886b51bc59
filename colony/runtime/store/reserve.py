"""Room on a disk that is put aside, so that what has been begun can be finished when the disk gets full."""

from __future__ import annotations

import os
from pathlib import Path

from colony.os_errors import NO_ROOM, naming

RESERVE_BYTES = 2 << 20
"""Size of the reserve: two of the largest values, or some thousand small changes."""


class Reserve:
    """A file that takes up room and contains nothing. Mutable: whether it is there.

    Args:
        path: of the file, on the disk whose room is put aside.
        size: of the room, in bytes.
    """

    def __init__(self, path: Path, size: int = RESERVE_BYTES) -> None:
        self._path = path
        self._size = size

    def take(self) -> None:
        """Take up the room, unless that is done; on a disk that cannot put room aside do without.

        Raises:
            OSError: the disk has no room for it.
        """
        try:
            file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                with naming(self._path):
                    os.posix_fallocate(file, 0, self._size)
            finally:
                os.close(file)
        except OSError as problem:
            self.give_up()  # a part of it may have been taken
            if problem.errno in NO_ROOM:
                raise

    def give_up(self) -> None:
        """Leave the room to others; again is nothing."""
        try:
            self._path.unlink(missing_ok=True)
        except OSError:
            return  # a disk that cannot even do this has nothing to give
