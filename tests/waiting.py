"""Waiting for a condition, instead of sleeping for luck, and processes that do not outlive a test."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import AnyStr, TypeVar

PATIENCE_S = 120.0
"""Timeout of what takes a second on an idle machine; tests also run on busy ones. Only failures reach it."""

T = TypeVar("T")


def until(condition: Callable[[], T], what: str, *, patience_s: float = PATIENCE_S) -> T:
    """Return what the condition gives as soon as that is something."""
    end = time.monotonic() + patience_s
    while True:
        found = condition()
        if found:
            return found
        assert time.monotonic() < end, f"waited {patience_s:g} s in vain: {what}"
        time.sleep(0.002)


@contextmanager
def killed_in_the_end(process: subprocess.Popen[AnyStr]) -> Iterator[subprocess.Popen[AnyStr]]:
    """Lend a process to the block, and kill it where it lives still, also when the block fails."""
    try:
        yield process
    finally:
        process.kill()
        process.communicate()
