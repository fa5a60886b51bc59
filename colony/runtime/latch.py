"""The emergency stop, at both ends of it.

The Clock has the latch: it keeps the stop in a file, repeats it in every tick, and alone releases it. A
server of actuators has a `StopFollower`: it is stopped by a call of its own or by a tick, tells so in its
frames, and goes on when a tick carries a release that is not earlier than its stop. So nobody who heard a
stop needs anybody else to stay stopped; and a Clock that missed the call, or was started again, learns of it
from frames.

    stop heard at t   is over   once a release at r >= t is known, and only then

The file is replaced as a whole. One that cannot be read counts as a stop: a robot that may have been stopped
for a reason does not drive on because of a bad disk.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from colony.runtime.messages import Stopped, Tick

NEVER_NS = -1
"""The time of a release where there was none."""


class _Kept(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The file's content."""

    stopped: Stopped | None
    released_ns: int


class StopLatch:
    """The Clock's memory of the emergency stop. Mutable: whether it is on, and whether the file says so.

    Args:
        path: the file, which need not exist; None: a restart forgets the stop.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._saved = True
        self.trouble: str | None = None
        """Why the file is not as it should be; None where it is."""
        self.stopped: Stopped | None = None
        self.released_ns = NEVER_NS
        if path is not None:
            self._load(path)

    def engage(self, stopped: Stopped) -> None:
        """Stop; the first of several stops is the one that is remembered."""
        if self.stopped is None:
            self.stopped = stopped
            self._saved = False
        self._saved = self._saved and self.trouble is None  # a file that could not be read is written anew
        self.save()

    def observe(self, stopped: Stopped | None) -> None:
        """Take over the stop that a server's frame tells of, unless it is over."""
        if stopped is not None and self.stopped is None and stopped.t_ns > self.released_ns:
            self.engage(stopped)

    def release(self, now_ns: int) -> None:
        """End every stop that was heard until now."""
        self.stopped = None
        self.released_ns = now_ns
        self._saved = False
        self.save()

    def save(self) -> None:
        """Write the file where it is not as it should be; what is in the way of that is `trouble`."""
        if self._saved or self._path is None:
            return
        try:
            _replace(
                self._path, msgspec.json.encode(_Kept(stopped=self.stopped, released_ns=self.released_ns))
            )
        except OSError as problem:
            self.trouble = f"{self._path}: {problem.strerror or problem}"
            return
        self._saved, self.trouble = True, None

    def _load(self, path: Path) -> None:
        try:
            kept = msgspec.json.decode(path.read_bytes(), type=_Kept)
        except FileNotFoundError:
            return
        except (OSError, msgspec.DecodeError, UnicodeDecodeError) as problem:
            self.trouble = f"{path}: {problem}"
            self.stopped = Stopped(by="a file that cannot be read", t_ns=0)
        else:
            self.stopped, self.released_ns = kept.stopped, kept.released_ns


class StopFollower:
    """Whether a server's actuators are stopped. Mutable: that."""

    def __init__(self) -> None:
        self.stopped: Stopped | None = None

    def hear(self, stopped: Stopped) -> None:
        """Stop; a second stop lasts for as long as the later of both."""
        if self.stopped is None or stopped.t_ns > self.stopped.t_ns:
            by = stopped.by if self.stopped is None else self.stopped.by
            self.stopped = Stopped(by=by, t_ns=stopped.t_ns)

    def follow(self, tick: Tick) -> None:
        """Stop or go on, as the Clock says."""
        if self.stopped is not None and tick.released_ns >= self.stopped.t_ns:
            self.stopped = None
        if self.stopped is None:
            self.stopped = tick.stopped


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
