"""Work on all cores: one function applied to many items, with results as they arrive.

An engine decides only where the work is done. The result of an item depends on the item alone, so results are
the same for any number of workers and any order of completion.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing.process import BaseProcess
from typing import Protocol, TypeVar

T = TypeVar("T")
R = TypeVar("R")

_QUEUED_PER_WORKER = 3
"""Number of items in progress or queued per worker, enough to keep it busy."""


class WorkersLostError(Exception):
    """A worker died during its work; the message suggests what to do."""


class Engine(Protocol):
    """An executor of work, in this process or others."""

    def results(self, work: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
        """Yield the result of `work` for each item, in the order of completion. Both must be picklable.

        Raises:
            WorkersLostError: a worker died.
        """
        ...


class SerialEngine:
    """An engine that works in this process, in order."""

    def results(self, work: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
        """Yield the result of `work` for each item, in order."""
        return map(work, items)


class PoolEngine:
    """An engine that works in `workers` processes on this machine, by default one per core."""

    def __init__(self, workers: int | None = None) -> None:
        self.workers = workers or os.cpu_count() or 1

    def results(self, work: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
        """Yield the result of `work` for each item, as the worker processes finish them."""
        context = multiprocessing.get_context("spawn")
        before = set(multiprocessing.active_children())
        count = max(1, min(self.workers, len(items)))
        pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin_worker)
        try:
            queue = iter(items)
            running = {pool.submit(work, item) for item in islice(queue, _QUEUED_PER_WORKER * count)}
            while running:
                done, running = wait(running, return_when=FIRST_COMPLETED)
                running |= {pool.submit(work, item) for item in islice(queue, len(done))}
                yield from _results_of(done)
        except BrokenProcessPool:
            raise WorkersLostError(
                "a worker process died, perhaps because memory ran out; finished runs are kept: run the "
                "command again with fewer --workers"
            ) from None
        except BaseException:  # abandon the work in progress
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _results_of(done: set[Future[R]]) -> Iterator[R]:
    for future in done:
        yield future.result()


def _begin_worker() -> None:
    """Make a worker ignore Ctrl-C, and end with its parent.

    Ctrl-C reaches every process of a terminal, but only the parent must handle it. When the parent has ended,
    for any reason, its work is useless.
    """
    # Set before numpy is loaded: each worker has one core, for which more threads would only compete.
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)
