"""What scripts of the navigation ask of DServer: semaphores that may be 0, variables that may be unset."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

from colony.runtime.kit.errors import CallRefused
from colony.runtime.kit.script import Step, do
from colony.runtime.library import data


def taken(semaphore: str, wait_s: float) -> Generator[Step, Any, bool]:
    """Down a semaphore; False where that was not possible for so many seconds, 0 for not at all.

    Raises:
        CallRefused: there is no such semaphore.
    """
    try:
        yield from do("DServer", data.wait(semaphore, timeout_s=wait_s))
    except CallRefused as refused:
        if refused.code != "timeout":
            raise
        return False
    return True


def values(*names: str) -> Generator[Step, Any, dict[str, Any] | None]:
    """Variables at one moment, or None where one of them was never set."""
    try:
        return (yield from do("DServer", data.get_many(names)))
    except CallRefused as refused:
        if refused.code not in ("unknown", "unset"):
            raise
        return None
