"""The emergency stop, at the Clock and at the servers of actuators.

The Clock has the `StopLatch`: it keeps the stop in a file, repeats it in every tick, and alone releases it. A
server of actuators has a `StopFollower`: a call to the server or a tick stops it, its frames carry the stop,
and it resumes when a tick carries a release that is not earlier than the stop. So a server that received a
stop needs no other process to stay stopped, and a Clock that missed the call, or was restarted, learns of the
stop from frames:

    a stop received at t is over once a release at r >= t is known, and only then

A file that cannot be read counts as a stop: a robot that may have been stopped must not drive on because of a
bad disk. `StopFile` describes the file.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from zlib import crc32

import msgspec

from colony.backoff import Backoff
from colony.files import open_descriptor, read_all, reason, sync_folder
from colony.runtime.protocol.messages import Stopped, Tick

# --- stop file -----------------------------------------------------------------------------------------
#
# The file in which the Clock keeps the emergency stop, so that a restarted Clock knows of it.
#
# Its size never changes, and it is written in place: once the file exists, keeping a stop needs no further
# space, so that it works on a full disk. (A copy-on-write file system, such as btrfs, may still need space;
# if there is none, the stop is not kept, and the Clock reports that.) A checksum covers the whole content.
# Content torn by a loss of power, or written by another program, cannot be read: the Clock treats that as a
# stop.
#
# The file stays open. `is_intact` detects that the path leads to another file or nowhere, or that the
# content has changed; a restarted Clock would then not find what was written.


FILE_BYTES = 4096
"""Size of the file: one block of common file systems, and one page of memory."""

_MAGIC = b"colony stop 1 "
_BODY_BYTES = FILE_BYTES - len(_MAGIC) - 9
_FLAGS = os.O_NOFOLLOW
"""Do not follow symbolic links: writing through one would change a file that is not the Clock's."""


class StopState(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The content of the file: the stop in force, and the time of the last release."""

    stopped: Stopped | None
    released_ns: int


class StopFileError(Exception):
    """Content that no Clock wrote, or that is incomplete."""


class StopFile:
    """The file at `path`.

    Stateful: keeps the descriptor while the file is open for writing, and the content written last.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor: int | None = None
        self._written = b""
        self._leftover = path.with_name(f"{path.name}.new")

    def read(self) -> StopState | None:
        """Return the content, None if there is no file yet.

        Raises:
            StopFileError: the content is damaged, or there is a `.new` file, left by the Clock of an earlier
                version that died while it replaced this file.
            OSError: the file cannot be read.
        """
        if os.path.lexists(self._leftover):
            raise StopFileError(f"{self._leftover.name} was left over")
        try:
            descriptor = open_descriptor(self.path, os.O_RDONLY | _FLAGS)
        except FileNotFoundError:
            return None
        with open(descriptor, "rb") as file:
            return _decode(read_all(file, FILE_BYTES, self.path))

    def write(self, state: StopState) -> None:
        """Write the file, creating it if the path leads to none, and wait until the disk has it.

        Raises:
            OSError: the content is not kept.
        """
        data, must_open = _encode(state), not self._is_in_place
        try:
            if must_open:
                self.close()
                self._descriptor = self._open_for_writing()
            assert self._descriptor is not None
            _write(self._descriptor, data)
            self._written = data
            if must_open or os.path.lexists(self._leftover):
                self._leftover.unlink(missing_ok=True)
                sync_folder(self.path.parent)
            if not self._is_in_place:
                raise OSError(errno.ESTALE, "it was moved while it was being written")
        except OSError:
            self.close()
            raise

    @property
    def is_intact(self) -> bool:
        """True if the path leads to the open file, and its content is what was written last."""
        if self._descriptor is None:
            return False
        try:
            return self._is_in_place and os.pread(self._descriptor, FILE_BYTES + 1, 0) == self._written
        except OSError:
            return False

    def close(self) -> None:
        """Close the file; closing twice does nothing."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            os.close(descriptor)

    @property
    def _is_in_place(self) -> bool:
        if self._descriptor is None:
            return False
        try:
            return os.path.samestat(os.lstat(self.path), os.fstat(self._descriptor))
        except OSError:
            return False

    def _open_for_writing(self) -> int:
        """Open the file for writing; if there is none, create it with all of its space allocated."""
        try:
            return open_descriptor(self.path, os.O_RDWR | _FLAGS)
        except FileNotFoundError:
            descriptor = open_descriptor(self.path, os.O_RDWR | os.O_CREAT | os.O_EXCL | _FLAGS)
        try:
            # until its content is written, readers treat the file as damaged: a stop
            _write(descriptor, bytes(FILE_BYTES))
        except OSError:
            os.close(descriptor)
            self.path.unlink(missing_ok=True)
            raise
        return descriptor


def _write(descriptor: int, data: bytes) -> None:
    if os.pwrite(descriptor, data, 0) != len(data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    if os.fstat(descriptor).st_size != len(data):
        os.ftruncate(descriptor, len(data))
    os.fdatasync(descriptor)


def _encode(state: StopState) -> bytes:
    body = msgspec.json.encode(state).ljust(_BODY_BYTES - 1) + b"\n"
    assert len(body) == _BODY_BYTES
    return b"%s%08x %s" % (_MAGIC, crc32(body), body)


def _decode(data: bytes) -> StopState:
    head, body = data[:-_BODY_BYTES], data[-_BODY_BYTES:]
    if not data:
        raise StopFileError("it is empty")
    if len(data) != FILE_BYTES or not head.startswith(_MAGIC):
        raise StopFileError("no Clock of this version wrote it")
    if head != b"%s%08x " % (_MAGIC, crc32(body)):
        raise StopFileError("it is damaged: the checksum is wrong")
    try:
        state = msgspec.json.decode(body, type=StopState)
        msgspec.msgpack.encode(state)  # a time that a tick could not carry is invalid
    except (msgspec.DecodeError, UnicodeDecodeError, OverflowError) as problem:
        raise StopFileError(str(problem)) from None
    return state


# --- stop latch ----------------------------------------------------------------------------------------


NEVER_RELEASED_NS = -1
"""Time of the last release if there was none."""

UNREADABLE = "a file that cannot be read"
"""Author of a stop that is assumed because the stop file cannot be read."""

MAX_AUTHOR_LENGTH = 255
"""Maximum length kept of a stop's author; each character takes at most six bytes in the file."""

CHECK_NS = 1_000_000_000
"""Nanoseconds between two checks that the file is intact."""

MIN_RETRY_NS, MAX_RETRY_NS = 50_000_000, 1_000_000_000
"""Shortest and longest delay, in nanoseconds, before a failed write of the file is retried."""


class StopLatch:
    """The Clock's record of the emergency stop. Mutable.

    Args:
        path: stop file, which need not exist; with None, a restart forgets the stop.
        report: callback for a line to users about each new problem with the file.
    """

    def __init__(self, path: Path | None, *, report: Callable[[str], None] = lambda line: None) -> None:
        self._file = None if path is None else StopFile(path)
        self._report = report
        self._saved = self._unreadable = False
        self._due_ns = 0
        self._retries = Backoff(MIN_RETRY_NS, MAX_RETRY_NS)
        self.trouble: str | None = None
        """The reason why the file could not be read or written; None if all is well."""
        self.stopped: Stopped | None = None
        self.released_ns = NEVER_RELEASED_NS

    def begin(self, now_ns: int) -> None:
        """Load the file, or create it so that its disk space is reserved; `now_ns` is the robot's time.

        A time in the file later than `now_ns` is from before a reboot: such a stop counts as received now,
        and such a release is forgotten, as are the stops that it ended.
        """
        if self._file is not None:
            self._load(self._file)
        if self.stopped is not None and self.stopped.t_ns > now_ns:
            self.stopped = Stopped(by=self.stopped.by, t_ns=now_ns)
        if self.released_ns > now_ns:
            self.released_ns = NEVER_RELEASED_NS
        if not self._unreadable:
            self._write()

    def engage(self, stopped: Stopped) -> None:
        """Stop; of several stops the first is kept. Afterwards it is in the file, or `trouble` is set.

        The file is written for each stop, even if it seems up to date, because each stop is acknowledged.
        """
        if self.stopped is None:
            self.stopped = Stopped(by=stopped.by[:MAX_AUTHOR_LENGTH], t_ns=stopped.t_ns)
        self._saved = False
        self._write()

    def observe(self, stopped: Stopped | None) -> None:
        """Take over the stop that a server's frame carries, unless it has been released."""
        if stopped is not None and self.stopped is None and stopped.t_ns > self.released_ns:
            self.engage(stopped)

    def release(self, now_ns: int) -> None:
        """End every stop received until `now_ns`; then the release is in the file, or `trouble` is set."""
        self.stopped = None
        self.released_ns = now_ns
        self._saved = False
        self._write()

    def save(self, now_ns: int) -> None:
        """Keep the file in place and up to date; call this in each frame.

        After a failure the file is retried with growing pauses. A file that could not be read stays as it is
        until the robot is stopped or released.
        """
        if self._unreadable or now_ns < self._due_ns:
            return
        self._write()
        if self.trouble:
            self._due_ns = now_ns + self._retries.next()
        else:
            self._retries.reset()
            self._due_ns = now_ns + CHECK_NS

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def _write(self) -> None:
        """Write the file unless it is up to date and unchanged on disk; set or clear `trouble`."""
        self._unreadable = False
        if self._file is None or (self._saved and self._file.is_intact):
            return
        try:
            self._file.write(StopState(stopped=self.stopped, released_ns=self.released_ns))
        except (OSError, ValueError) as problem:
            self._note_trouble("an emergency stop cannot be saved", f"{self._file.path}: {reason(problem)}")
        else:
            self._saved, self.trouble = True, None

    def _load(self, file: StopFile) -> None:
        try:
            state = file.read()
        except (OSError, ValueError, StopFileError) as problem:
            self._unreadable = True
            self.stopped = Stopped(by=UNREADABLE, t_ns=0)
            self._note_trouble(
                "stopped until released, because the stop file cannot be read",
                f"{file.path}: {reason(problem)}",
            )
            return
        if state is not None:
            self.stopped, self.released_ns = state.stopped, state.released_ns

    def _note_trouble(self, summary: str, trouble: str) -> None:
        if trouble != self.trouble:
            self.trouble = trouble
            self._report(f"{summary}: {trouble}")


class StopFollower:
    """The emergency stop at a server. Stateful: remembers the stop that keeps its actuators idle, if any."""

    def __init__(self) -> None:
        self.stopped: Stopped | None = None

    def engage(self, stopped: Stopped) -> None:
        """Stop; of two stops, the later one decides which release ends it."""
        if self.stopped is None or stopped.t_ns > self.stopped.t_ns:
            by = stopped.by if self.stopped is None else self.stopped.by
            self.stopped = Stopped(by=by, t_ns=stopped.t_ns)

    def follow(self, tick: Tick) -> None:
        """Stop or resume according to the Clock's tick."""
        if self.stopped is not None and tick.released_ns >= self.stopped.t_ns:
            self.stopped = None
        if self.stopped is None:
            self.stopped = tick.stopped
