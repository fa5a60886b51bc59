"""The emergency stop, at the Clock and at the servers of actuators.

The Clock has the `StopLatch`: it keeps the stop in a file, repeats it in every tick, and alone releases it. A
server of actuators has a `StopFollower`: a call of its own or a tick stops it, its frames carry the stop, and
it goes on when a tick carries a release that is not earlier than the stop. So a server that heard a stop
needs no other process to stay stopped, and a Clock that missed the call, or was restarted, learns of the stop
from frames.

    stop heard at t   is over   once a release at r >= t is known, and only then

The file is replaced as a whole. A file that cannot be read counts as a stop: a robot that may have been
stopped for a reason does not drive on because of a bad disk.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from colony.runtime.messages import Stopped, Tick

NEVER_RELEASED_NS = -1
"""The time of the last release if there was none."""


class _Kept(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The content of the file."""

    stopped: Stopped | None
    released_ns: int


class StopLatch:
    """The Clock's memory of the emergency stop. Mutable: whether it is on, and whether the file says so.

    Args:
        path: the file, which need not exist; with None, a restart forgets the stop.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._saved = True
        self.trouble: str | None = None
        """The reason why the file could not be read or written; None if all is well."""
        self.stopped: Stopped | None = None
        self.released_ns = NEVER_RELEASED_NS
        if path is not None:
            self._load(path)

    def begin(self, now_ns: int) -> None:
        """Begin at this time of the robot. What the file dates later is of another clock, from before the
        machine was started again: a stop holds from now on, and a release is that of stops which nobody
        remembers."""
        if self.stopped is not None and self.stopped.t_ns > now_ns:
            self.stopped = Stopped(by=self.stopped.by, t_ns=now_ns)
        if self.released_ns > now_ns:
            self.released_ns = NEVER_RELEASED_NS

    def engage(self, stopped: Stopped) -> None:
        """Stop; of several stops the first is remembered."""
        if self.stopped is None:
            self.stopped = stopped
            self._saved = False
        self._saved = self._saved and self.trouble is None  # replace a file that could not be read
        self.save()

    def observe(self, stopped: Stopped | None) -> None:
        """Take over the stop that a server's frame carries, unless it has been released."""
        if stopped is not None and self.stopped is None and stopped.t_ns > self.released_ns:
            self.engage(stopped)

    def release(self, now_ns: int) -> None:
        """End every stop that was heard until `now_ns`."""
        self.stopped = None
        self.released_ns = now_ns
        self._saved = False
        self.save()

    def save(self) -> None:
        """Write the file if it is out of date; on failure set `trouble`, to try again at the next call."""
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
            msgspec.msgpack.encode(kept)  # what a tick could not carry is no time
        except FileNotFoundError:
            return
        except (OSError, msgspec.DecodeError, UnicodeDecodeError, OverflowError) as problem:
            self.trouble = f"{path}: {problem}"
            self.stopped = Stopped(by="a file that cannot be read", t_ns=0)
        else:
            self.stopped, self.released_ns = kept.stopped, kept.released_ns


class StopFollower:
    """A server's part in the emergency stop. Mutable: the stop that keeps its actuators idle, if any."""

    def __init__(self) -> None:
        self.stopped: Stopped | None = None

    def hear(self, stopped: Stopped) -> None:
        """Stop; of two stops, the later one has to be released."""
        if self.stopped is None or stopped.t_ns > self.stopped.t_ns:
            by = stopped.by if self.stopped is None else self.stopped.by
            self.stopped = Stopped(by=by, t_ns=stopped.t_ns)

    def follow(self, tick: Tick) -> None:
        """Stop or go on, as the Clock's tick says."""
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
