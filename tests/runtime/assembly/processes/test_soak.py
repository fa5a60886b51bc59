"""A run in which every process but the leader is frozen and killed; `make soak` is a longer one."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.runtime.assembly.processes.soak import soak

SEED = 1994
SECONDS = float(os.environ.get("COLONY_SOAK_SECONDS", "30"))


@pytest.mark.parametrize("isolate", [True, False], ids=["alone", "together"])
def test_processes_keep_their_memory_and_decisions_are_the_interpreters(
    tmp_path: Path, isolate: bool
) -> None:
    print(f"seed {SEED}, {SECONDS:g} s (COLONY_SOAK_SECONDS)")
    figures = soak(tmp_path, seconds=SECONDS, seed=SEED, isolate=isolate)
    print(figures)
    assert figures.problems() == []
