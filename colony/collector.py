"""The garbage collector of cycles, paused where there are none to be found."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def gc_paused() -> Iterator[None]:
    """Pause the collection of cycles inside the `with`.

    Stages make many objects and no cycles, and the collector, going over all of them time and again, takes
    a third of the time of a large network.
    """
    running = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if running:
            gc.enable()


@contextmanager
def collector_past_startup() -> Iterator[None]:
    """Keep the garbage collector, inside, from looking at all that has been made so far.

    A process that runs for long goes over its modules and tables time and again, and finds nothing.
    """
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
