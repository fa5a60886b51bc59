"""Work on all cores: the same function over many items, results as they come.

An engine decides where the work is done and nothing else: what an item gives depends on the item alone, so
results are the same however many workers there are and in whatever order they finish.
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

_AHEAD = 3
"""Items that wait for each worker: enough to keep it busy."""


class WorkersLostError(Exception):
    """A worker died during its work; the message suggests a remedy."""


class Engine(Protocol):
    """Does work somewhere."""

    def results(self, work: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
        """Yield the result of `work` for each item, in the order in which they finish. Both can be pickled.

        Raises:
            WorkersLostError: they cannot be done.
        """
        ...


class SerialEngine:
    """Does the work in this process, in order."""

    def results(self, work: Callable[[T], R], items: Sequence[T]) -> Iterator[R]:
        """Yield the result of `work` for each item, in order."""
        return map(work, items)


class PoolEngine:
    """Does the work in `workers` processes of this machine, by default one a core."""

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
            running = {pool.submit(work, item) for item in islice(queue, _AHEAD * count)}
            while running:
                done, running = wait(running, return_when=FIRST_COMPLETED)
                running |= {pool.submit(work, item) for item in islice(queue, len(done))}
                yield from _results_of(done)
        except BrokenProcessPool:
            raise WorkersLostError(
                "a worker process died, perhaps for want of memory; what was finished is kept: run it again, "
                "with fewer --workers"
            ) from None
        except BaseException:  # the work under way is given up, not waited for
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

    Ctrl-C reaches every process of a terminal, and only the first is to act on it; when that one is gone,
    however it ended, the work is of no use.
    """
    # Before numpy is loaded: each worker has a core, and more threads would wait for those of the others.
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: BaseProcess) -> None:
    parent.join()
    os._exit(1)
