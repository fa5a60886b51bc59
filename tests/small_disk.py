"""A disk that a test can fill to the last byte or make read-only: a tmpfs of its own.

It is mounted in a user and mount namespace, which a process holds that waits. Other processes join the
namespace to see the disk; the test looks into it from outside.
"""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import TracebackType

import pytest

_HOLD = 'mount -t tmpfs -o "$1",mode=700 tmpfs "$0" && echo mounted && exec cat'


class SmallDisk:
    """A tmpfs at `folder`, for the processes whose command begins with `enter`. Mutable: what is on it."""

    def __init__(self, folder: Path, options: str = "size=64k") -> None:
        self.folder = folder
        folder.mkdir(parents=True)
        try:
            self._holder = subprocess.Popen(
                ["unshare", "--user", "--map-root-user", "--mount", "sh", "-c", _HOLD, str(folder), options],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        except FileNotFoundError as missing:
            pytest.skip(f"there is no {missing.filename} here")
        assert self._holder.stdout is not None
        if self._holder.stdout.readline() != "mounted\n":
            _, said = self._holder.communicate()
            pytest.skip(f"no disk of one's own can be mounted here: {said.strip()}")
        pid = str(self._holder.pid)
        self.enter = ("nsenter", "--user", "--mount", "--preserve-credentials", "--target", pid)
        self.seen = Path(f"/proc/{pid}/root{folder}")
        """The folder, as the test sees it."""

    def fill(self) -> None:
        """Take what is left, to the last byte."""
        with (self.seen / "filler").open("ab", buffering=0) as file:
            size = 4096
            while size:
                try:
                    file.write(bytes(size))
                except OSError:
                    size //= 2

    def free(self) -> None:
        """Give back what `fill` took."""
        (self.seen / "filler").unlink()

    def remount(self, options: str) -> None:
        """Change how it is mounted: "ro" or "rw"."""
        subprocess.run(
            [*self.enter, "mount", "-o", f"remount,{options}", str(self.folder)], check=True, timeout=30
        )

    def close(self) -> None:
        """Let go of it; it is gone with the last process that sees it."""
        self._holder.communicate()

    def __enter__(self) -> SmallDisk:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
