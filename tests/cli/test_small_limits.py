"""Small limits of a process, odd folders and closed streams: one line and an exit code, never a traceback."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.machine import MAP, ROBOT, WANDER
from tests.commands import Ran
from tests.paths import ROOT
from tests.sampling import long, sampled

RUN = ("run", WANDER, "--map", MAP, "--no-picture", "--duration", "1")
PROCESSES = (*RUN, "--processes")
ALL = ("serve", "all", "--robot", ROBOT, "--map", MAP)
DSERVER = ("serve", "DServer", "--robot", ROBOT)

Command = tuple[str, ...]


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., Ran]:
    """Run `colony ARGUMENTS` as a process whose limits are `limits`, with redirections of a shell."""

    def run(
        *arguments: str, limits: dict[int, int] | None = None, redirect: str = "", folder: bytes = b"r"
    ) -> Ran:
        def limit() -> None:
            for which, most in (limits or {}).items():
                resource.setrlimit(which, (most, most))

        environment = {
            **{os.fsencode(name): os.fsencode(value) for name, value in os.environ.items()},
            b"COLONY_RUN_DIR": bytes(tmp_path) + b"/" + folder,
            b"XDG_STATE_HOME": bytes(tmp_path) + b"/s",
            b"PYTHONPATH": bytes(ROOT),
        }
        command = [sys.executable, "-m", "colony.cli.main", *arguments]
        done = subprocess.run(
            ["bash", "-c", f'"$@" {redirect}', "bash", *command],
            env=environment,
            cwd=tmp_path,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=120,
            preexec_fn=limit,
        )
        out, err = done.stdout.decode(), done.stderr.decode()
        assert "Traceback" not in err
        assert "panicked" not in err
        return Ran(done.returncode, out, err)

    return run


@pytest.mark.parametrize(
    ("command", "code", "said"),
    [
        (PROCESSES, 2, "this process may have 8 files open"),
        (ALL, 2, "oo"),
        (DSERVER, 1, "/base: Too many open files: raise the limit of open files"),
    ],
)
def test_few_files_may_be_open(run: Callable[..., Ran], command: Command, code: int, said: str) -> None:
    done = run(*command, limits={resource.RLIMIT_NOFILE: 8})
    assert (done.code, done.err.count("\n")) == (code, 1)
    assert said in done.err
    assert "`ulimit -n`" in done.err


@pytest.mark.parametrize("most", sampled([12, 16, 20, 24, 32, 40], every=3, thorough=True))
def test_a_few_more_files_may_be_open(run: Callable[..., Ran], most: int) -> None:
    done = run(*PROCESSES, limits={resource.RLIMIT_NOFILE: most})
    assert done.code in (1, 2)
    assert "`ulimit -n`" in done.err


@pytest.mark.parametrize(
    ("command", "mb"),
    [(RUN, 60), long(RUN, 100), (RUN, 150), long(RUN, 200), long(PROCESSES, 60), (PROCESSES, 100), (ALL, 60)],
)
def test_little_memory(run: Callable[..., Ran], command: Command, mb: int) -> None:
    done = run(*command, limits={resource.RLIMIT_AS: mb * 1_000_000})
    assert done.code == 1
    assert done.out == ""
    # the last one is OpenBLAS, which ends the process by itself
    assert done.err == "colony: error: out of memory\n" or done.err.startswith(
        "OpenBLAS error: Memory allocation"
    )


@pytest.mark.parametrize("command", [PROCESSES, ALL, DSERVER])
def test_a_run_directory_that_is_not_utf8(run: Callable[..., Ran], command: Command) -> None:
    done = run(*command, folder=b"r\xff")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "must be UTF-8" in done.err
    assert "set COLONY_RUN_DIR" in done.err


FULL, CLOSED = ("> /dev/full", "No space left on device"), (">&-", "Bad file descriptor")
CHECK = ("check", WANDER)


@pytest.mark.parametrize(
    ("command", "redirect", "why"),
    [
        (("--help",), *FULL),
        (CHECK, *CLOSED),
        (("ps",), *CLOSED),
        long(RUN, *FULL),
        long(("map", MAP), *FULL),
    ],
)
def test_output_that_cannot_be_written(
    run: Callable[..., Ran], command: Command, redirect: str, why: str
) -> None:
    done = run(*command, redirect=redirect)
    assert done.code == 2
    assert done.err.splitlines()[-1] == f"colony: error: standard output: cannot write: {why}"


@pytest.mark.parametrize("redirect", ["2>&-", long("2> /dev/full")])
def test_messages_that_cannot_be_written_change_nothing(run: Callable[..., Ran], redirect: str) -> None:
    done = run(*RUN, redirect=redirect)
    assert done.code == 0
    assert f"{ROBOT}: 1.0 s, 20 frames" in done.out
    assert run(*DSERVER, "--state", "/dev/null/nowhere", redirect=redirect).code == 2


def test_a_file_is_not_taken_for_a_stream_that_was_closed(run: Callable[..., Ran], tmp_path: Path) -> None:
    done = run(*RUN, "--record", "run.jsonl", redirect="<&- >&- 2>&-")
    assert done.code == 2
    lines = (tmp_path / "run.jsonl").read_text().splitlines()
    assert all(line.startswith("{") for line in lines)


def test_another_file_is_not_taken_for_standard_output(run: Callable[..., Ran], tmp_path: Path) -> None:
    """A limit of the size of files breaks a recording off, and nobody blames standard output for it."""
    done = run(*RUN, "--record", "run.jsonl", limits={resource.RLIMIT_FSIZE: 4096})
    assert done.code == 1
    assert "the recording run.jsonl contains only the first " in done.out
    assert "File too large: raise the limit of file sizes (`ulimit -f`)" in done.out
    assert "standard output" not in done.err
