"""Recordings with a flipped bit, and some that unpack to much: a sample of `make attack`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.sampling import long, thorough
from tools.attack.damage import costs, flips, record

TRIALS = 15


@pytest.mark.parametrize("name", ["run.mcap", long("run.jsonl")])
@pytest.mark.parametrize("killed", [thorough(False), True], ids=["whole", "killed"])
def test_what_is_damaged_is_never_compared(name: str, killed: bool, tmp_path: Path) -> None:
    came = flips(record(tmp_path / name, seconds=3.0, killed=killed), name, trials=TRIALS, seed=2)
    assert came.wrong == ()
    assert came.told > 0


@pytest.mark.long
def test_bombs_are_refused(tmp_path: Path) -> None:
    recording = record(tmp_path / "run.mcap", seconds=1.0, killed=False)
    for what, command, _, took in costs(tmp_path, recording):
        assert took.code in (1, 2), (what, command, took)
        assert took.megabytes < 400, (what, command, took)
        assert "Traceback" not in took.said
