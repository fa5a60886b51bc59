"""The file in which the Clock keeps the emergency stop, so that a restarted Clock knows of it.

Its size never changes, and it is written in place: once the file exists, keeping a stop needs no further
space, so that it works on a full disk. (A copy-on-write file system, such as btrfs, may still need space; if
there is none, the stop is not kept, and the Clock reports that.) A checksum covers the whole content.
Content torn by a loss of power, or written by another program, cannot be read: the Clock treats that as a
stop.

The file stays open. `is_intact` detects that the path leads to another file or nowhere, or that the content
has changed; a restarted Clock would then not find what was written.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path
from zlib import crc32

import msgspec

from colony.files import open_descriptor, read_all, sync_folder
from colony.runtime.protocol.messages import Stopped

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
