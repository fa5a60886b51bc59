"""Ctrl-C while z3's Python side is at work."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interruptions() -> Iterator[None]:
    """While it lasts, Ctrl-C is a KeyboardInterrupt wherever it comes.

    One that comes while ctypes converts an argument for z3 is raised by ctypes as an ArgumentError, which
    names it in its text alone.
    """
    try:
        yield
    except ctypes.ArgumentError as problem:
        if KeyboardInterrupt.__name__ not in str(problem):
            raise
        raise KeyboardInterrupt from None
