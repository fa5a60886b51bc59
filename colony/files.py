"""Files from outside, opened without blocking and read within a limit.

A name can refer to a pipe without a writer, an endless device, or a file that grows while it is read.
Therefore only regular files are opened, and each is read up to a limit that the caller gives. Devices are not
even opened, because opening some of them has side effects.
"""

from __future__ import annotations

import errno
import os
import resource
import stat
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import BinaryIO

# --- files ---------------------------------------------------------------------------------------------


StrPath = str | os.PathLike[str]

COMPILED = b"colonyc"
"""The first bytes of every file that contains a compiled program."""

MAX_LINKS = 40
"""Maximum number of symbolic links on the way to a folder, that of Linux."""

CLAIM_BYTES = 32
"""Size of a claimed file in bytes: the id of a process, padded with blanks."""

CLAIM_TRIES = 10
CLAIM_PAUSE_S = 0.01

_CHUNK = 1 << 20
_SAFE_FLAGS = os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY


class UnsuitableFileError(OSError):
    """A file is not a regular file, is too large, or has a line that is too long."""


def open_descriptor(path: StrPath, flags: int = os.O_RDONLY) -> int:
    """Open a regular file, or create one if `flags` say so, without ever blocking.

    Raises:
        OSError: it is not a regular file (`UnsuitableFileError`), or cannot be opened; `strerror` gives the
            reason.
    """
    try:
        _check(os.lstat(path) if flags & os.O_NOFOLLOW else os.stat(path), path)
    except FileNotFoundError:
        pass
    except ValueError as problem:
        raise UnsuitableFileError(errno.EINVAL, str(problem), path) from None
    descriptor = os.open(path, flags | _SAFE_FLAGS, 0o600)
    try:
        _check(os.fstat(descriptor), path)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def open_regular(path: StrPath) -> BinaryIO:
    """Open a regular file for reading.

    Raises:
        OSError: see `open_descriptor`.
    """
    return open(open_descriptor(path), "rb")


def read_file(path: StrPath, max_bytes: int) -> bytes:
    """Return the content of a regular file of at most `max_bytes` bytes.

    Raises:
        OSError: see `open_descriptor`; or the file is larger or grows beyond the limit while it is read.
    """
    with open_regular(path) as file:
        return read_all(file, max_bytes, path)


def read_all(file: BinaryIO, max_bytes: int, path: StrPath) -> bytes:
    """Return the rest of an open file, at most `max_bytes` bytes; `path` is for messages.

    Raises:
        OSError: the file cannot be read, or has more bytes.
    """
    if os.fstat(file.fileno()).st_size > max_bytes:
        raise UnsuitableFileError(errno.EFBIG, f"it is larger than {size_text(max_bytes)}", path)
    data = bytearray()
    while chunk := file.read(min(_CHUNK, max_bytes + 1 - len(data))):
        data += chunk
        if len(data) > max_bytes:
            raise UnsuitableFileError(errno.EFBIG, f"it is larger than {size_text(max_bytes)}", path)
    return bytes(data)


def bounded_lines(file: BinaryIO, max_bytes: int) -> Iterator[bytes]:
    """Yield the lines of a file as they arrive, each with its line break.

    Raises:
        OSError: it cannot be read, or a line has more than `max_bytes` bytes (`UnsuitableFileError`).
    """
    number = 0
    while line := file.readline(max_bytes + 1):
        number += 1
        if len(line) > max_bytes:
            raise UnsuitableFileError(errno.EFBIG, f"line {number} is longer than {size_text(max_bytes)}")
        yield line


def user_cache(environment: Mapping[str, str], name: str) -> Path | None:
    """Return a path in the user's cache: `$XDG_CACHE_HOME/colony/NAME`, or `~/.cache/colony/NAME`.

    None if the environment has neither.
    """
    folder = user_folder(environment, "XDG_CACHE_HOME", ".cache")
    return None if folder is None else folder / name


def user_folder(environment: Mapping[str, str], variable: str, in_home: str) -> Path | None:
    """Return `$VARIABLE/colony`, or `$HOME/IN_HOME/colony`; None if neither is an absolute path."""
    base, home = environment.get(variable, ""), environment.get("HOME", "")
    if os.path.isabs(base):
        return Path(base) / "colony"
    return Path(home) / in_home / "colony" if os.path.isabs(home) else None


def own_folder(path: Path) -> None:
    """Create a folder for the user alone, if it is missing, and check that no other user can write to it.

    Raises:
        OSError: it cannot be created; or another user owns it, one above it or a link to it, or can write to
            it or move it (`UnsuitableFileError`).
    """
    if not path.is_absolute():
        raise UnsuitableFileError(errno.EINVAL, "it is not an absolute path", path)
    trusted = {os.geteuid(), os.stat("/").st_uid}  # that of / is 0, or what stands for it in a container
    folder, rest, links = Path("/"), [*reversed(path.parts[1:])], 0
    while rest:
        name = rest.pop()
        step = folder.parent if name == ".." else folder / name
        if not os.path.lexists(step):
            step.mkdir(mode=0o700, exist_ok=True)
        status = step.lstat()
        if status.st_uid not in trusted:  # who may replace it, and what is in it, also where it is sticky
            raise UnsuitableFileError(errno.EPERM, f"another user owns {step}", path)
        if stat.S_ISLNK(status.st_mode):
            links += 1
            if links > MAX_LINKS:
                raise UnsuitableFileError(errno.ELOOP, os.strerror(errno.ELOOP), path)
            target = step.readlink()
            folder = Path("/") if target.is_absolute() else folder
            rest += reversed([part for part in target.parts if part != "/"])
            continue
        writable = stat.S_IWOTH | (stat.S_IWGRP if status.st_gid != os.getegid() else 0)
        if status.st_mode & writable and not status.st_mode & stat.S_ISVTX:
            raise UnsuitableFileError(errno.EPERM, f"other users can write to {step}", path)
        folder = step
    _expect_own(folder.stat(), folder)


def _expect_own(status: os.stat_result, path: Path) -> None:
    if status.st_uid != os.geteuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise UnsuitableFileError(errno.EPERM, f"{path} is not of this user alone", path)


def read_from_cache(path: Path, max_bytes: int) -> bytes:
    """Return the content of a file of the user's cache.

    Raises:
        OSError: see `read_file`; or other users can write to it or its folder (see `own_folder`), or it is a
            link.
    """
    if path.parent.exists():
        own_folder(path.parent)
    with open(open_descriptor(path, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
        _expect_own(os.fstat(file.fileno()), path)
        return read_all(file, max_bytes, path)


def keep_in_cache(path: Path, data: bytes) -> None:
    """Write a file of the user's cache, whole or not at all.

    Raises:
        OSError: it cannot be written, or other users can write to its folder (see `own_folder`).
    """
    own_folder(path.parent)
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with open(handle, "wb") as file:
            file.write(data)
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(temporary)
        raise


def size_text(size: int) -> str:
    """Return a size limit in bytes as text for people."""
    for unit, text in ((1 << 20, "MiB"), (1 << 10, "KiB"), (10**6, "MB")):
        if size % unit == 0:
            return f"{size // unit} {text}"
    return f"{size} bytes"


def reason(problem: Exception) -> str:
    """Return the reason why a file cannot be used, without the file's name."""
    return (problem.strerror if isinstance(problem, OSError) else None) or str(problem)


def sync_folder(path: Path) -> None:
    """Wait until the entries of a folder are on the disk.

    Raises:
        OSError: the folder cannot be synchronized.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _check(status: os.stat_result, path: StrPath) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise UnsuitableFileError(errno.EISDIR, os.strerror(errno.EISDIR), path)
    if not stat.S_ISREG(status.st_mode):
        raise UnsuitableFileError(errno.EINVAL, "it is not a regular file", path)


def open_exclusive(path: str) -> FileIO:
    """Open an unbuffered file for appending, truncate it, and lock it against other runs.

    Raises:
        OSError: the file cannot be opened, or another run holds the lock (`BlockingIOError`).
    """
    file = FileIO(path, "a")
    try:
        if stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            try:
                _lock(file.fileno())
            except BlockingIOError:
                raise
            except OSError:  # a file system without locks
                pass
            file.truncate(0)
    except BaseException:
        file.close()
        raise
    return file


class ClaimedError(Exception):
    """Another process has a claim; the message is its process id, or `unknown`."""


class FileClaim(AbstractContextManager["FileClaim"]):
    """An exclusive claim, held by a lock on a file until it is closed or the process ends. Mutable.

    Raises:
        ClaimedError: another process has it.
        OSError: the file cannot be opened or locked.
    """

    def __init__(self, path: StrPath) -> None:
        descriptor = open_descriptor(path, os.O_RDWR | os.O_CREAT)
        try:
            if not _try_lock(descriptor):
                holder = os.read(descriptor, CLAIM_BYTES).decode("ascii", "replace").strip()
                raise ClaimedError(holder or "unknown")
        except BaseException:
            os.close(descriptor)
            raise
        self._descriptor = descriptor

    def sign(self) -> None:
        """Write the id of this process into the file, for `claim_holder`.

        The file keeps its size, so that the claim can be signed again even when the disk is full.

        Raises:
            OSError: it cannot be written.
        """
        os.pwrite(self._descriptor, f"{os.getpid():<{CLAIM_BYTES - 1}}\n".encode(), 0)

    def close(self) -> None:
        """Release the claim. Idempotent."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    def __exit__(self, *raised: object) -> None:
        """Release the claim."""
        self.close()


def claim_holder(path: StrPath) -> int | None:
    """Return the id of the process that has a claim; None if no process has it.

    Raises:
        OSError: the file cannot be opened or locked.
    """
    try:
        descriptor = open_descriptor(path)
    except (FileNotFoundError, UnsuitableFileError):
        return None
    try:
        _lock(descriptor, shared=True)
    except BlockingIOError:
        text = os.read(descriptor, CLAIM_BYTES).strip()
        return int(text) if text.isdigit() else None
    else:
        return None
    finally:
        os.close(descriptor)


def _try_lock(descriptor: int) -> bool:
    """Try to lock a file, several times, because `claim_holder` locks it briefly, too."""
    for _ in range(CLAIM_TRIES):
        try:
            _lock(descriptor)
        except BlockingIOError:
            time.sleep(CLAIM_PAUSE_S)
        else:
            return True
    return False


def _lock(descriptor: int, *, shared: bool = False) -> None:
    """Lock a file until it is closed, if the system has such locks.

    Raises:
        BlockingIOError: another process has a lock that excludes this one.
        OSError: the file system has no locks.
    """
    if sys.platform == "win32":
        return
    import fcntl

    fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)


# --- os errors -----------------------------------------------------------------------------------------
#
# Operating system errors: messages that name the file and explain limits.


NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""Error codes for a full disk, an exhausted quota, or a file at its size limit."""

_ADVICE = {
    errno.EMFILE: "raise the limit of open files (`ulimit -n`)",
    errno.EFBIG: "raise the limit of file sizes (`ulimit -f`)",
}

_OUT_OF_MEMORY_TEXTS = ("failed to map segment", "annot allocate memory", "can't start new thread")
"""Messages of libraries and threads that could not be loaded or started for lack of memory."""


@contextmanager
def naming(path: str | os.PathLike[str]) -> Iterator[None]:
    """Set the file name of an OSError that lacks one, such as an error of reading, writing or closing."""
    try:
        yield
    except OSError as problem:
        if problem.filename is None:
            problem.filename = os.fspath(path)
        raise


def describe(problem: OSError) -> str:
    """Return the error in one line, with its file and with advice if it is due to a limit."""
    what = f"{os.fsdecode(problem.filename)}: " if isinstance(problem.filename, (str, bytes)) else ""
    advice = limit_advice(problem)
    return f"{what}{problem.strerror or problem}{'' if advice is None else f': {advice}'}"


def limit_advice(problem: OSError) -> str | None:
    """Return advice if an error is due to a limit of the process, else None."""
    # An UnsuitableFileError is due to a limit of this program, not of the process.
    if problem.errno is None or isinstance(problem, UnsuitableFileError):
        return None
    return _ADVICE.get(problem.errno)


def is_out_of_memory(problem: BaseException) -> bool:
    """Return True if memory for an object, a library or a thread could not be allocated.

    Under a memory limit (`ulimit -v`) libraries report the lack of memory in different ways. A library that
    was found but cannot be loaded therefore counts as out of memory under such a limit, and so does a
    `SystemError`, which Python raises where C code failed without an exception.
    """
    if isinstance(problem, MemoryError) or (isinstance(problem, OSError) and problem.errno == errno.ENOMEM):
        return True
    if isinstance(problem, (ImportError, RuntimeError, OSError)) and any(
        t in str(problem) for t in _OUT_OF_MEMORY_TEXTS
    ):
        return True
    if isinstance(problem, ModuleNotFoundError):
        return False
    is_vague = isinstance(problem, ImportError | SystemError) or (
        isinstance(problem, OSError) and problem.errno is None
    )
    return is_vague and resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY
