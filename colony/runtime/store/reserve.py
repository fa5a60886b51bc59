"""Disk space in reserve, so that work in progress can be completed when the disk fills up."""

from __future__ import annotations

import os
from pathlib import Path

from colony.os_errors import NO_ROOM, naming

RESERVE_BYTES = 2 << 20
"""Size of the reserve: room for two of the largest values, or a few thousand small changes."""


class Reserve:
    """A file that occupies disk space and has no content. Stateful: the file may exist or not.

    Args:
        path: file on the disk whose space is reserved.
        size: size of the reserve, in bytes.
    """

    def __init__(self, path: Path, size: int = RESERVE_BYTES) -> None:
        self._path = path
        self._size = size

    def take(self) -> None:
        """Allocate the space if it is not yet allocated; do nothing if the file system cannot preallocate.

        Raises:
            OSError: the disk has too little space.
        """
        try:
            file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                with naming(self._path):
                    os.posix_fallocate(file, 0, self._size)
            finally:
                os.close(file)
        except OSError as problem:
            self.release()  # part of the space may have been allocated
            if problem.errno in NO_ROOM:
                raise

    def release(self) -> None:
        """Release the space. Calling this again has no effect."""
        try:
            self._path.unlink(missing_ok=True)
        except OSError:
            return  # a disk that cannot even delete a file has no space to release
