"""Pauses of the cyclic garbage collector where no garbage cycles are expected."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def gc_paused() -> Iterator[None]:
    """Pause the collection of cycles inside the `with`.

    Compiler stages create many objects and no cycles. The collector, which scans all of them repeatedly,
    would take a third of the compile time of a large network.
    """
    running = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if running:
            gc.enable()


@contextmanager
def gc_frozen() -> Iterator[None]:
    """Exclude all objects created so far from garbage collection inside the `with`.

    In a long-running process the collector scans modules and tables repeatedly, and finds nothing.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
