"""The child processes of a supervisor: monitored, restarted, and ended in order.

Each child is started from scratch (never forked from a process with an open session), in its own process
group, so that Ctrl-C at a terminal reaches only the supervisor, which then ends the others in order. When a
process has ended, the rest of its group is killed. The output of a process goes to its own log. When it dies,
the last lines are shown that it wrote, unless a signal ended it that leaves no time to write: what it had
written before would not explain its death.
"""

from __future__ import annotations

import os
import signal
import site
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, NamedTuple

import colony
from colony.files import open_regular
from colony.runtime.assembly.processes.restarts import Restarts
from colony.runtime.assembly.processes.shutdown import EXIT_FINAL, kill_group

TAIL_BYTES = 4096
TAIL_LINES = 8
"""Maximum part of a log that is shown when its process dies."""

LOG_BYTES = 16 * 1024 * 1024
"""Size in bytes beyond which a log is emptied."""

LOG_INTERVAL_NS = 1_000_000_000
"""Nanoseconds between two checks of a log's size."""

EXPLAINED_SIGNALS = frozenset({signal.SIGSEGV, signal.SIGFPE, signal.SIGABRT, signal.SIGBUS, signal.SIGILL})
"""Signals of which Python's fault handler writes into the log where they hit the process."""

POLL_INTERVAL_S = 0.005
"""Seconds between two checks whether a terminated process has ended."""

HEALTH_CHECK_INTERVAL_S = 0.05
"""Seconds between two health checks of the processes."""

SHUTDOWN_GRACE_S = 2.5
"""Grace period of a shutdown wave in seconds before its processes are killed.

It is longer than the processes need to end on their own.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A process to start: `module` is run with `arguments`, and its output goes into the file `log`.

    Attributes:
        wave: shutdown wave; processes of wave 0 are ended first.
        essential: True if the run ends when the process dies and is not restarted.
        clients: addresses of the clients that run in the process.
        others: the servers that share the process of the server `name`.
        gives_up: False if it is restarted however often it dies in quick succession.
    """

    name: str
    module: str
    arguments: tuple[str, ...]
    log: Path
    wave: int
    essential: bool
    clients: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    gives_up: bool = True

    @property
    def title(self) -> str:
        """The name of the process, with the servers that share it."""
        return f"{self.name} (with {', '.join(self.others)})" if self.others else self.name


class Death(NamedTuple):
    """The unexpected end of a process.

    `tail` has the last lines of its output, if they may explain its death. `pause_s` is the time until its
    restart, None if it is not restarted. `final` is True if its exit code means that a restart is no help.
    """

    job: Job
    cause: str
    tail: tuple[str, ...]
    pause_s: float | None
    final: bool


class RunFailedError(Exception):
    """The processes cannot begin or continue; the message, of one line or several, gives the reason."""


@dataclass(frozen=False, slots=True)
class _Child:
    job: Job
    process: subprocess.Popen[bytes] | None = None
    log_start: int = 0
    began_ns: int = 0
    due_ns: int | None = None
    log_due_ns: int = 0
    restarts: Restarts = field(default_factory=Restarts)


class Children:
    """The child processes of a supervisor. Mutable.

    Args:
        clock: monotonic clock in nanoseconds.
    """

    def __init__(self, *, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._clock = clock
        self._children: dict[str, _Child] = {}

    def start(self, job: Job) -> None:
        """Start a process.

        Raises:
            ValueError: another process has this name.
            OSError: the process could not be started.
        """
        if job.name in self._children:
            raise ValueError(f"two processes have the name {job.name}")
        job.log.unlink(missing_ok=True)
        child = _Child(job, restarts=Restarts(gives_up=job.gives_up))
        self._children[job.name] = child
        self._spawn(child)

    def poll(self) -> tuple[Death, ...]:
        """Return the deaths since the last call, and restart processes that are due."""
        return tuple(death for child in self._children.values() for death in self._check(child))

    def check(
        self,
        on_death: Callable[[Death], None],
        is_required: Callable[[Job], bool] = lambda job: job.essential,
    ) -> None:
        """Restart the processes that are due, and pass on the deaths since the last call.

        Raises:
            RunFailedError: a required process died and is not restarted.
        """
        for death in self.poll():
            if death.pause_s is None and is_required(death.job):
                raise RunFailedError(describe(death))
            on_death(death)

    def pid(self, name: str) -> int | None:
        """Return the id of a live process, None for any other."""
        child = self._children.get(name)
        return child.process.pid if child is not None and child.process is not None else None

    def pids(self) -> dict[str, int]:
        """Return the ids of the live processes by name; may be called from any thread."""
        processes = ((child.job.name, child.process) for child in tuple(self._children.values()))
        return {name: process.pid for name, process in processes if process is not None}

    def restarts(self) -> int:
        """Return the number of restarts."""
        return sum(child.restarts.total for child in self._children.values())

    def stop(self, grace_s: float) -> tuple[str, ...]:
        """End all processes, wave by wave; return the names of those that had to be killed.

        If interrupted, it sends SIGTERM to the remaining processes, which then end by themselves.
        """
        killed: list[str] = []
        try:
            for wave in sorted({child.job.wave for child in self._children.values()}):
                killed += self._end([c for c in self._children.values() if c.job.wave == wave], grace_s)
        finally:
            self._release_all()
        return tuple(killed)

    # --- one process ---------------------------------------------------------------------------------

    def _spawn(self, child: _Child) -> None:
        python = (sys.executable, "-P", "-u", "-X", "faulthandler")
        with _log(child.job.log) as log:
            child.log_start = log.seek(0, os.SEEK_END)
            child.process = subprocess.Popen(
                [*python, "-m", child.job.module, *child.job.arguments],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=_environment(),
                process_group=0,
            )
        child.began_ns, child.due_ns = self._clock(), None

    def _check(self, child: _Child) -> Iterator[Death]:
        if child.process is None:
            if child.due_ns is not None and self._clock() >= child.due_ns:
                self._spawn(child)
            return
        code = _exit_code(child.process)
        if code is None:
            if (now := self._clock()) >= child.log_due_ns:
                child.log_due_ns = now + LOG_INTERVAL_NS
                _limit_log(child.job.log)
            return
        _release(child)
        now = self._clock()
        if code == EXIT_FINAL:
            child.due_ns = None
        else:
            killed = code == -signal.SIGKILL
            child.due_ns = child.restarts.next_start(child.began_ns, now, killed=killed)
        pause_s = None if child.due_ns is None else (child.due_ns - now) / 1e9
        yield Death(child.job, _cause(code), _explanation(child, code), pause_s, code == EXIT_FINAL)
        if child.due_ns is not None and child.due_ns <= now:
            self._spawn(child)

    def _end(self, children: list[_Child], grace_s: float) -> Iterable[str]:
        for child in children:
            child.due_ns = None
            if child.process is not None:
                child.process.send_signal(signal.SIGTERM)
        deadline = time.monotonic() + grace_s
        living = [c for c in children if c.process is not None]
        while living and time.monotonic() < deadline:
            living = [c for c in living if c.process is not None and _exit_code(c.process) is None]
            if living:
                time.sleep(POLL_INTERVAL_S)
        for child in living:
            assert child.process is not None
            child.process.kill()
            _exit_code(child.process, os.WEXITED)
        for child in children:
            _release(child)
        return [child.job.name for child in living]

    def _release_all(self) -> None:
        for child in self._children.values():
            if child.process is not None:
                child.process.send_signal(signal.SIGTERM)
            _release(child)


def _exit_code(process: subprocess.Popen[bytes], options: int = os.WEXITED | os.WNOHANG) -> int | None:
    """Return the exit code of a process that has ended, None if it has not.

    Its forked processes are killed before it is reaped, because until then no other group can have its id.
    """
    with suppress(ChildProcessError):  # raised if SIGCHLD is ignored
        if os.waitid(os.P_PID, process.pid, options | os.WNOWAIT) is None:
            return None
    kill_group(process.pid)
    return process.wait()


def _release(child: _Child) -> None:
    """Close the standard input of a process, which ends it if it is still alive."""
    process, child.process = child.process, None
    if process is not None:
        stdin: IO[bytes] | None = process.stdin
        if stdin is not None:
            stdin.close()


def _log(path: Path) -> IO[bytes]:
    """Open the log of a process; if it cannot be created, as on a full disk, output is dropped."""
    try:
        return open(path, "ab", opener=_open_private)
    except OSError:
        return open(os.devnull, "ab")


def _limit_log(path: Path) -> None:
    """Empty the log of a process if it has grown beyond the limit."""
    with suppress(OSError):
        if path.stat().st_size > LOG_BYTES:
            os.truncate(path, 0)
            with open(path, "ab") as log:
                log.write(f"earlier lines were dropped: more than {LOG_BYTES >> 20} MiB\n".encode())


def _open_private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


ONE_ARENA = "1"
"""Number of heaps of the C library, in the format of `MALLOC_ARENA_MAX`.

Otherwise threads that come and go with connections get their own heaps, whose free memory no other thread
can use (measured: 15 MB instead of 2 MB in a server after the death of 178 clients).
"""


def _environment() -> dict[str, str]:
    """Return the environment of a child: this process's, with defaults for missing settings.

    It lets the child find this package even if it is not installed.
    """
    root = str(Path(colony.__file__).parent.parent)
    environment = {"MALLOC_ARENA_MAX": ONE_ARENA, **os.environ}
    if root not in site.getsitepackages():
        inherited = environment.get("PYTHONPATH")
        environment["PYTHONPATH"] = root if not inherited else os.pathsep.join((root, inherited))
    return environment


def _cause(code: int) -> str:
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"was killed by signal {-code}"


def _explanation(child: _Child, code: int) -> tuple[str, ...]:
    """Return the last lines that a process wrote before it ended; none after a signal that it cannot note."""
    if code < 0 and -code not in EXPLAINED_SIGNALS:
        return ()
    return last_lines(child.job.log, child.log_start)


def last_lines(path: Path, start: int = 0) -> tuple[str, ...]:
    """Return the last few lines of a text file; none if it cannot be read.

    Args:
        path: the file.
        start: number of bytes at its beginning that are left out, unless the file is shorter by now.
    """
    try:
        with open_regular(path) as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(start if start <= size else 0, size - TAIL_BYTES))
            text = file.read().decode("utf-8", "replace")
    except OSError:
        return ()
    return tuple(line for line in text.splitlines() if line.strip())[-TAIL_LINES:]


def describe(death: Death) -> str:
    """Describe a death for users: its cause, what happens next, and the last lines of the process."""
    name, pause_s = death.job.title, death.pause_s
    if death.final and death.tail:
        return f"{name}: {death.tail[-1]}"
    if pause_s is None:
        consequence = "it is not restarted"
    else:
        consequence = "it is restarted" + (f" in {pause_s:.2g} s" if pause_s > 0 else "")
    lines = [f"{name} {death.cause}; {consequence}"]
    if death.tail:
        lines += [f"last lines of {death.job.log}:", *(f"  {line}" for line in death.tail)]
    return "\n".join(lines)
