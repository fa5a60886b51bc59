"""Children of a supervisor: kept alive, given up, ended in order, and never left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from colony.runtime.assembly.processes.children import Children, Death, Job, describe, last_lines
from colony.runtime.assembly.processes.restarts import (
    FIRST_PAUSE_NS,
    MAX_PAUSE_NS,
    MAX_QUICK_DEATHS,
    STABLE_NS,
    UNHURRIED_NS,
    Restarts,
)
from tests.waiting import PATIENCE_S, until

# Unbuffered, `print` writes a line and its end separately, so that a death in between would join two lines.

OBEYS = """
import sys
from colony.runtime.assembly.processes.shutdown import Shutdown, on_parent_exit, on_signals
shutdown = Shutdown()
with on_signals(shutdown):
    on_parent_exit(shutdown)
    print("here\\n", end="", flush=True)
    shutdown.wait()
print("closed:", shutdown.reason, flush=True)
"""

HANDLES = """
import os, signal
from colony.runtime.assembly.processes.shutdown import Shutdown, on_signals
shutdown = Shutdown()
signal.signal(signal.SIGUSR1, lambda *_: None)
with on_signals(shutdown):
    os.kill(os.getpid(), signal.SIGUSR1)
    os.kill(os.getpid(), signal.SIGTERM)
    shutdown.wait()
print("closed:", shutdown.reason, flush=True)
"""

IGNORES = """
import signal, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("here\\n", end="", flush=True)
while True: time.sleep(1)
"""

FORKS = """
import os, signal, sys
from colony.runtime.assembly.processes.shutdown import Shutdown, on_parent_exit, on_signals
shutdown = Shutdown()
with on_signals(shutdown):
    on_parent_exit(shutdown)
    forked = os.fork()
    while not forked:
        signal.pause()
    print(f"{forked}\\n", end="", flush=True)
    shutdown.wait()
shutdown.end_forked()
"""

FLOODS = """
import sys, time
print("x" * 100_000, flush=True)
sys.stdin.buffer.raw.read(1)
"""

EMPTIED = ("earlier lines were dropped: more than 0 MiB",)

FAILS = "raise OSError('no such luck')"

GRUMBLES = """
import signal, sys, time
signal.signal(signal.SIGUSR1, lambda *_: sys.exit("it is enough"))
print("trouble\\n", end="", flush=True)
time.sleep(60)
"""

WRONG = """
from colony.runtime.assembly.processes.shutdown import exit_with
exit_with("no such robot")
"""

HEAPS = """
import ctypes, sys, tempfile, threading, time
libc = ctypes.CDLL(None)
libc.malloc.restype, libc.fopen.restype = ctypes.c_void_p, ctypes.c_void_p
barrier = threading.Barrier(8)
def use():
    barrier.wait()
    for _ in range(100):
        libc.malloc(100)
    barrier.wait()
threads = [threading.Thread(target=use) for _ in range(8)]
for thread in threads: thread.start()
for thread in threads: thread.join()
with tempfile.NamedTemporaryFile() as file:
    stream = ctypes.c_void_p(libc.fopen(file.name.encode(), b"w"))
    libc.malloc_info(0, stream)
    libc.fclose(stream)
    count = file.read().decode().count("<heap nr=")
    print(f"heaps: {count}", flush=True)  # in one write: it is read as it comes
time.sleep(60)
"""

PARENT = """
import sys, time
from pathlib import Path
from colony.runtime.assembly.processes.children import Children, Job
children = Children()
folder, name = Path(sys.argv[1]), sys.argv[2]
log = folder / f"{name}.log"
children.start(Job(name=name, module=name, arguments=(), log=log, wave=0, essential=True))
print(children.pid(name), flush=True)
time.sleep(60)
"""


_MODULES = (
    ("obeys", OBEYS),
    ("handles", HANDLES),
    ("floods", FLOODS),
    ("forks", FORKS),
    ("ignores", IGNORES),
    ("fails", FAILS),
    ("grumbles", GRUMBLES),
    ("wrong", WRONG),
    ("heaps", HEAPS),
)


def lives(pid: int) -> bool:
    """Whether there is such a process, and it is no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def job(folder: Path, module: str, wave: int = 0, name: str | None = None) -> Job:
    log = folder / f"{name or module}.log"
    return Job(name=name or module, module=module, arguments=(), log=log, wave=wave, essential=True)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in _MODULES:
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return tmp_path


@pytest.fixture
def children() -> Iterator[Children]:
    made = Children()
    yield made
    made.stop(PATIENCE_S)


def pid_of(children: Children, name: str) -> int:
    pid = children.pid(name)
    assert pid is not None
    return pid


def polled(children: Children, deaths: list[Death]) -> list[Death]:
    """Look after the children, and give the deaths so far."""
    deaths.extend(children.poll())
    return deaths


def said(folder: Path, name: str) -> tuple[str, ...]:
    return last_lines(folder / f"{name}.log")


def test_a_first_death_is_mended_at_once_and_the_next_ones_later_and_later() -> None:
    restarts, now = Restarts(), 0
    pauses = []
    while (at := restarts.next_start(now, now)) is not None:
        pauses.append(at - now)
        now = at
    assert pauses[0] == 0
    assert pauses == sorted(pauses)
    assert len(pauses) == MAX_QUICK_DEATHS - 1
    assert max(pauses) <= MAX_PAUSE_NS


def test_who_lived_for_long_is_started_at_once_again() -> None:
    restarts, now = Restarts(), 0
    for _ in range(3 * MAX_QUICK_DEATHS):
        assert restarts.next_start(now, now + STABLE_NS) == now + STABLE_NS
        now += STABLE_NS
    assert restarts.total == 3 * MAX_QUICK_DEATHS


def test_who_is_killed_is_never_given_up_and_waits_only_if_that_comes_at_once_again() -> None:
    restarts, now = Restarts(), 0
    for _ in range(3 * MAX_QUICK_DEATHS):
        assert restarts.next_start(now, now, killed=True) == now
        assert restarts.next_start(now, now, killed=True) == now + FIRST_PAUSE_NS
        assert restarts.next_start(now, now + UNHURRIED_NS, killed=True) == now + UNHURRIED_NS
        now += UNHURRIED_NS
    assert restarts.next_start(now, now) == now, "none of them failed"


def test_a_log_that_grows_too_large_is_emptied(
    children: Children, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("colony.runtime.assembly.processes.children.LOG_BYTES", 50_000)
    children.start(job(folder, "floods"))
    log = folder / "floods.log"
    until(lambda: (children.poll(), said(folder, "floods") == EMPTIED)[1], "it is emptied")
    assert log.stat().st_size < 50_000


def test_one_that_is_killed_is_started_again(children: Children, folder: Path) -> None:
    children.start(job(folder, "obeys", name="client"))
    first = pid_of(children, "client")
    until(lambda: said(folder, "client") == ("here",), "it starts")
    os.kill(first, 9)
    deaths: list[Death] = []
    until(lambda: polled(children, deaths), "the death is seen")
    assert (deaths[0].cause, deaths[0].tail, deaths[0].pause_s) == ("was killed by SIGKILL", (), 0.0)
    assert pid_of(children, "client") != first
    assert children.restarts() == 1
    until(lambda: said(folder, "client") == ("here", "here"), "it starts again")


def test_a_signal_that_a_module_handles_ends_no_process(children: Children, folder: Path) -> None:
    children.start(job(folder, "handles"))
    until(lambda: said(folder, "handles"), "it ends")
    assert said(folder, "handles") == ("closed: SIGTERM",)


def test_threads_of_a_process_share_one_heap(children: Children, folder: Path) -> None:
    children.start(job(folder, "heaps"))
    until(lambda: said(folder, "heaps"), "it tells")
    assert said(folder, "heaps") == ("heaps: 1",)


def test_one_that_cannot_live_is_given_up(folder: Path) -> None:
    now = [0]
    children = Children(clock=lambda: now[0])
    children.start(job(folder, "fails"))
    deaths: list[Death] = []

    def poll() -> bool:
        now[0] += 1_000_000
        found = children.poll()
        deaths.extend(found)
        now[0] += sum(int(d.pause_s * 1e9) for d in found if d.pause_s is not None)
        return bool(deaths) and deaths[-1].pause_s is None

    until(poll, "it is given up")
    assert len(deaths) == MAX_QUICK_DEATHS
    assert deaths[-1].cause == "ended with exit code 1"
    assert deaths[-1].tail[-1] == "OSError: no such luck"
    assert children.pid("fails") is None
    assert children.stop(PATIENCE_S) == ()


def test_one_that_was_started_wrongly_is_given_up_at_once(children: Children, folder: Path) -> None:
    children.start(job(folder, "wrong"))
    deaths: list[Death] = []
    until(lambda: polled(children, deaths), "the death is seen")
    assert (deaths[0].pause_s, deaths[0].final) == (None, True)
    assert describe(deaths[0]) == "wrong: no such robot"


def test_a_death_is_told_with_the_last_words(folder: Path) -> None:
    death = Death(job(folder, "a"), "ended with exit code 1", ("x", "y"), 0.25, False)
    expected = ["a ended with exit code 1; it is restarted in 0.25 s"]
    expected += [f"last lines of {folder}/a.log:", "  x", "  y"]
    assert describe(death).splitlines() == expected
    assert describe(death._replace(tail=(), pause_s=None)) == "a ended with exit code 1; it is not restarted"
    shared = death._replace(job=replace(death.job, others=("b", "c")), tail=())
    assert describe(shared) == "a (with b, c) ended with exit code 1; it is restarted in 0.25 s"


def test_only_what_a_process_wrote_itself_explains_its_death(children: Children, folder: Path) -> None:
    children.start(job(folder, "grumbles"))
    deaths: list[Death] = []

    def die(number: int) -> Death:
        """Kill the process once it has written a line, and return its death."""
        so_far = len(deaths)
        until(lambda: len(said(folder, "grumbles")) > so_far, "it writes")
        os.kill(pid_of(children, "grumbles"), number)
        until(lambda: len(polled(children, deaths)) > so_far, "the death is seen")
        return deaths[-1]

    assert die(signal.SIGKILL).tail == ()
    assert die(signal.SIGUSR1).tail == ("trouble", "it is enough")
    assert len(said(folder, "grumbles")) == 3, "the log keeps what was written before"


def test_a_crash_is_told_with_the_place_of_it(children: Children, folder: Path) -> None:
    children.start(job(folder, "grumbles"))
    until(lambda: said(folder, "grumbles"), "it writes")
    os.kill(pid_of(children, "grumbles"), signal.SIGSEGV)
    deaths: list[Death] = []
    until(lambda: polled(children, deaths), "the death is seen")
    assert deaths[0].cause == "was killed by SIGSEGV"
    assert "Fatal Python error: Segmentation fault" in deaths[0].tail


def test_they_end_wave_by_wave(children: Children, folder: Path) -> None:
    for name, wave in (("b", 1), ("a", 0)):
        children.start(job(folder, "obeys", wave, name))
    pids = [pid_of(children, name) for name in "ab"]
    until(lambda: said(folder, "a") == said(folder, "b") == ("here",), "both start")
    assert children.stop(PATIENCE_S) == ()
    assert said(folder, "a") == said(folder, "b") == ("here", "closed: SIGTERM")
    assert (folder / "a.log").stat().st_mtime_ns <= (folder / "b.log").stat().st_mtime_ns
    assert not any(map(lives, pids))
    assert children.poll() == ()


def test_one_that_does_not_obey_is_killed(children: Children, folder: Path) -> None:
    children.start(job(folder, "ignores"))
    pid = pid_of(children, "ignores")
    until(lambda: said(folder, "ignores") == ("here",), "it starts")
    assert children.stop(0.01) == ("ignores",)
    assert not lives(pid)


def of_a_parent_that_is_killed(folder: Path, name: str) -> int:
    """The process of a child whose parent is killed as soon as it has said something."""
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, str(folder), name], stdout=subprocess.PIPE, text=True, bufsize=1
    )
    child = int(parent.stdout.readline())
    until(lambda: said(folder, name), "it starts")
    parent.kill()
    parent.wait()
    parent.stdout.close()
    return child


def forked_by(folder: Path) -> int:
    until(lambda: said(folder, "forks"), "it forks")
    forked = int(said(folder, "forks")[-1])
    assert lives(forked)
    return forked


def test_what_they_forked_ends_with_them(children: Children, folder: Path) -> None:
    children.start(job(folder, "forks"))
    first, forked = pid_of(children, "forks"), forked_by(folder)
    os.kill(first, signal.SIGKILL)
    until(lambda: children.poll(), "the death is seen")
    until(lambda: not lives(forked), "what it forked is killed")
    until(lambda: len(said(folder, "forks")) == 2, "it is started again")
    forked = forked_by(folder)
    assert children.stop(PATIENCE_S) == ()
    until(lambda: not lives(forked), "what it forked is killed")


def test_what_they_forked_ends_with_them_when_their_parent_is_killed(folder: Path) -> None:
    child = of_a_parent_that_is_killed(folder, "forks")
    until(lambda: not lives(child), "the child ends")
    until(lambda: not lives(int(said(folder, "forks")[-1])), "what it forked is killed")


def test_they_end_when_their_parent_is_killed(folder: Path) -> None:
    child = of_a_parent_that_is_killed(folder, "obeys")
    until(lambda: not lives(child), "the child ends")
    assert said(folder, "obeys") == ("here", "closed: the process that started it is gone")


def test_a_process_whose_log_cannot_be_made_runs_without(folder: Path, children: Children) -> None:
    children.start(replace(job(folder, "obeys"), log=folder / "no" / "such.log"))
    pid = pid_of(children, "obeys")
    os.kill(pid, signal.SIGKILL)
    deaths: list[Death] = []
    until(lambda: polled(children, deaths), "it is dead")
    assert [(death.cause, death.tail) for death in deaths] == [("was killed by SIGKILL", ())]
    until(lambda: children.poll() == () and lives(pid_of(children, "obeys")), "it is started again")
    assert pid_of(children, "obeys") != pid
