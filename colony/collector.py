"""A pause of the garbage collector of cycles, for stages that make none."""

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
