"""Runs and robots whose processes are frozen and killed; `make soak` is longer."""

from __future__ import annotations

import tempfile
from pathlib import Path
from random import Random

import pytest

from tools.freezes import SERVERS, freezes
from tools.soak import soak

SEED = 1994


@pytest.mark.long
@pytest.mark.parametrize(
    ("seconds", "isolate"),
    [
        pytest.param(6.0, False, id="6 s, together"),
        pytest.param(30.0, False, id="30 s, together", marks=pytest.mark.thorough),
        pytest.param(30.0, True, id="30 s, alone", marks=pytest.mark.thorough),
    ],
)
def test_processes_keep_their_memory_and_decisions_are_the_interpreters(
    tmp_path: Path, seconds: float, isolate: bool
) -> None:
    print(f"seed {SEED}")
    figures = soak(tmp_path, seconds=seconds, seed=SEED, isolate=isolate)
    print(figures)
    assert figures.problems() == []


@pytest.mark.long
def test_every_link_is_there_again_after_freezes() -> None:
    with tempfile.TemporaryDirectory(prefix="freezes-", dir="/tmp") as folder, freezes(Path(folder)) as robot:
        lacking = [robot.round(Random(seed), 6.0) for seed in range(3)]
        assert lacking == [frozenset()] * 3
        assert robot.missing(0) == frozenset() != SERVERS
