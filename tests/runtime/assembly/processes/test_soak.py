"""A run in which every process but the leader is frozen and killed; `make soak` is a longer one."""

from __future__ import annotations

import os
from pathlib import Path

from tests.runtime.assembly.processes.soak import soak

SEED = 1994
SECONDS = float(os.environ.get("COLONY_SOAK_SECONDS", "40"))


def test_processes_keep_their_memory_and_decisions_are_the_interpreters(tmp_path: Path) -> None:
    print(f"seed {SEED}, {SECONDS:g} s (COLONY_SOAK_SECONDS)")
    figures = soak(tmp_path, seconds=SECONDS, seed=SEED)
    print(figures)
    assert figures.problems() == []
