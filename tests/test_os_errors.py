"""Errors of the system name their file and say what to do; a lack of memory is told apart from bugs."""

from __future__ import annotations

import errno
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from colony.files import describe, is_out_of_memory, naming


def test_an_error_gets_the_name_of_its_file(tmp_path: Path) -> None:
    path = tmp_path / "a file"
    path.touch()
    file = os.open(path, os.O_RDONLY)
    with pytest.raises(OSError, match="Bad file descriptor") as failed, naming(path):
        os.write(file, b"x")
    os.close(file)
    assert describe(failed.value) == f"{path}: Bad file descriptor"


def test_a_name_that_is_there_stays() -> None:
    with pytest.raises(FileNotFoundError) as failed, naming("other"):
        os.stat("/nowhere")
    assert describe(failed.value) == "/nowhere: No such file or directory"


def test_what_is_said_of_errors_without_a_file() -> None:
    assert describe(OSError("no number")) == "no number"
    many = OSError(errno.EMFILE, os.strerror(errno.EMFILE), b"/a\xff")
    assert describe(many) == "/a\udcff: Too many open files: raise the limit of open files (`ulimit -n`)"


def test_lack_of_memory() -> None:
    assert is_out_of_memory(MemoryError())
    assert is_out_of_memory(OSError(errno.ENOMEM, "Cannot allocate memory"))
    assert is_out_of_memory(ImportError("libx.so: failed to map segment from shared object"))
    assert is_out_of_memory(RuntimeError("can't start new thread"))
    assert not is_out_of_memory(OSError(errno.ENOSPC, "No space left on device"))
    assert not is_out_of_memory(RuntimeError("a bug"))
    assert not is_out_of_memory(ModuleNotFoundError("x"))
    assert not is_out_of_memory(KeyError("can't start new thread"))
    limited = resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY
    assert is_out_of_memory(ImportError("no module named x")) is limited


def test_where_memory_is_limited_what_cannot_be_loaded_is_a_lack_of_it() -> None:
    script = (
        "import resource; from colony.files import is_out_of_memory\n"
        "resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))\n"
        "print(is_out_of_memory(ImportError('x')), is_out_of_memory(OSError('no number')), "
        "is_out_of_memory(OSError(28, 'No space')), is_out_of_memory(RuntimeError('x')), "
        "is_out_of_memory(ModuleNotFoundError('x')), is_out_of_memory(SystemError('x')))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "True True False False False True\n"
