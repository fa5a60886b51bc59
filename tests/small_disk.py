"""A small disk for tests, which can be filled: a tmpfs in a namespace that processes are started in."""

from __future__ import annotations

import errno
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

_HOLD = 'mount -t tmpfs -o "size=$2" small "$1" && echo ready && exec cat'


class SmallDisk:
    """A disk. Mutable: what is on it. Only processes that are started by `inside` have it at `path`.

    Args:
        path: of the folder that it is mounted at.
        holder: the process whose namespace has it.
    """

    def __init__(self, path: Path, holder: int) -> None:
        self.path = path
        self._holder = holder
        self.seen = Path(f"/proc/{holder}/root{path}")
        """The folder, as this process sees it."""

    @property
    def inside(self) -> tuple[str, ...]:
        """What a command begins with that is to have the disk."""
        return ("nsenter", "-t", str(self._holder), "-U", "-m", "--preserve-credentials", "--wd=.")

    def fill(self, *, but: int = 0) -> None:
        """Leave no room, but for so many bytes."""
        file = os.open(self._filler, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        try:
            while _written(file):
                pass
            if but:
                os.truncate(self._filler, self._filler.stat().st_size - but)
        finally:
            os.close(file)

    def clear(self) -> None:
        """Give back all the room that `fill` took."""
        self._filler.unlink()

    def remount(self, options: str) -> None:
        """Change how it is mounted: "ro" or "rw"."""
        command = [*self.inside, "mount", "-o", f"remount,{options}", str(self.path)]
        subprocess.run(command, check=True, timeout=30)

    @property
    def _filler(self) -> Path:
        return self.seen / "filler"


@contextmanager
def small_disk(path: Path, size: str) -> Iterator[SmallDisk]:
    """Mount a disk of `size`, as mount writes it, at a new folder `path`; skip where this may not be done."""
    path.mkdir()
    try:
        holder = subprocess.Popen(
            ["unshare", "-rm", "sh", "-c", _HOLD, "sh", str(path), size],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
    except FileNotFoundError:
        pytest.skip("there is no `unshare` here")
    with holder:
        assert holder.stdout is not None
        assert holder.stderr is not None
        if holder.stdout.readline() != "ready\n":
            pytest.skip(f"no namespace can be made here: {holder.stderr.read().strip()}")
        yield SmallDisk(path, holder.pid)
        # leaving the block closes the input of the holder, which ends; the disk ends with its last process


def _written(file: int) -> bool:
    """Write a little, a part of it where there is no room for all; whether there was room for any."""
    try:
        return os.write(file, bytes(1 << 16)) > 0
    except OSError as problem:
        if problem.errno != errno.ENOSPC:
            raise
        return False
