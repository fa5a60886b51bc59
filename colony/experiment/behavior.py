"""Behaviors by their files, compiled once a process."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from colony.dsl.load import load_file
from colony.runtime.assembly.behavior import Behavior, behavior_from


@lru_cache(maxsize=8)
def behavior_of(path: Path) -> Behavior:
    """Load and compile a behavior.

    Raises:
        Failure: it has errors, or is bound to what no server has.
    """
    return behavior_from(load_file(path))
