"""A run in which every process but the leader is frozen and killed; `make soak` is a longer one."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.runtime.assembly.processes.soak import soak

SEED = 1994


@pytest.mark.parametrize(
    ("seconds", "isolate"),
    [
        pytest.param(6.0, False, id="6 s, together"),
        pytest.param(30.0, False, id="30 s, together", marks=pytest.mark.thorough),
        pytest.param(30.0, True, id="30 s, alone", marks=pytest.mark.long),
    ],
)
def test_processes_keep_their_memory_and_decisions_are_the_interpreters(
    tmp_path: Path, seconds: float, isolate: bool
) -> None:
    print(f"seed {SEED}")
    figures = soak(tmp_path, seconds=seconds, seed=SEED, isolate=isolate)
    print(figures)
    assert figures.problems() == []
