"""What the operating system refuses: errors that name their file, and that tell of limits in plain words."""

from __future__ import annotations

import errno
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager

from colony.files import UnfitFile

NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""The disk is full, a quota is used up, or a file has reached the limit of its size."""

_ADVICE = {
    errno.EMFILE: "raise the limit of open files (`ulimit -n`)",
    errno.EFBIG: "raise the limit of file sizes (`ulimit -f`)",
}

_STARVED = ("failed to map segment", "annot allocate memory", "can't start new thread")
"""What libraries and threads say that could not be loaded or started for lack of memory."""


@contextmanager
def naming(path: str | os.PathLike[str]) -> Iterator[None]:
    """Give an OSError that names no file the name of this one: reading, writing and closing raise such."""
    try:
        yield
    except OSError as problem:
        if problem.filename is None:
            problem.filename = os.fspath(path)
        raise


def described(problem: OSError) -> str:
    """Return in a line what is wrong, with which file, and what to do about a limit."""
    what = f"{os.fsdecode(problem.filename)}: " if isinstance(problem.filename, (str, bytes)) else ""
    advice = limit_advice(problem)
    return f"{what}{problem.strerror or problem}{'' if advice is None else f': {advice}'}"


def limit_advice(problem: OSError) -> str | None:
    """Return what to do about a limit of the process, None if that is not the trouble."""
    if problem.errno is None or isinstance(problem, UnfitFile):  # the latter's limits are this program's own
        return None
    return _ADVICE.get(problem.errno)


def is_out_of_memory(problem: BaseException) -> bool:
    """Tell whether there was no memory for something: an object, a library, or a thread.

    Where a limit is set (`ulimit -v`) each library says so in its own way, so there one that cannot be loaded
    counts, unless it was not even found.
    """
    if isinstance(problem, MemoryError) or (isinstance(problem, OSError) and problem.errno == errno.ENOMEM):
        return True
    if isinstance(problem, (ImportError, RuntimeError, OSError)) and any(t in str(problem) for t in _STARVED):
        return True
    if isinstance(problem, ModuleNotFoundError):
        return False
    loading = isinstance(problem, ImportError) or (isinstance(problem, OSError) and problem.errno is None)
    return loading and resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY
