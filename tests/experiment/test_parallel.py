"""Work in several processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from pathlib import Path

import pytest

from colony.experiment.parallel import PoolEngine, SerialEngine, WorkersLostError
from tests.paths import ROOT
from tests.waiting import until


def _square(item: int) -> int:
    return item * item


def _die(item: int) -> int:
    if item == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def _fail(item: int) -> int:
    raise ValueError(f"item {item}")


def _sleep(item: int) -> int:
    time.sleep(0.0 if item == 0 else 60.0)
    return item


@pytest.mark.parametrize("engine", [SerialEngine(), PoolEngine(1), PoolEngine(3)])
def test_every_item_is_done_once(engine: SerialEngine | PoolEngine) -> None:
    assert sorted(engine.results(_square, range(50))) == [n * n for n in range(50)]
    assert list(engine.results(_square, [])) == []


def test_a_worker_that_dies_ends_the_work_with_a_hint() -> None:
    with pytest.raises(WorkersLostError, match="fewer --workers"):
        list(PoolEngine(1).results(_die, range(8)))


def test_what_the_work_raises_is_raised() -> None:
    with pytest.raises(ValueError, match="item 1"):
        list(PoolEngine(1).results(_fail, [1]))


def test_who_gives_up_does_not_wait_for_what_is_under_way() -> None:
    results = PoolEngine(2).results(_sleep, range(4))
    before = time.monotonic()
    assert next(results) == 0
    assert isinstance(results, Generator)
    with pytest.raises(KeyboardInterrupt):
        results.throw(KeyboardInterrupt())
    assert time.monotonic() - before < 30.0
    assert not multiprocessing.active_children()


@pytest.mark.skipif(os.name != "posix", reason="there is no SIGKILL")
def test_workers_end_with_a_parent_that_is_killed() -> None:
    program = (
        "from colony.experiment.parallel import PoolEngine\n"
        "from tests.experiment.test_parallel import own_pid\n"
        "if __name__ == '__main__':\n"
        "    for pid in PoolEngine(2).results(own_pid, range(10_000)):\n"
        "        print(pid, flush=True)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as parent:
        worker = int(parent.stdout.readline())
        parent.kill()
    until(lambda: not _lives(worker), "the worker ends")


def own_pid(item: int) -> int:
    time.sleep(0.01)
    return os.getpid()


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
        state = Path(f"/proc/{pid}/stat")
        return not state.parent.parent.is_dir() or state.read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False
