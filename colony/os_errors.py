"""Operating system errors: messages that name the file and explain limits."""

from __future__ import annotations

import errno
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager

from colony.files import UnsuitableFileError

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
