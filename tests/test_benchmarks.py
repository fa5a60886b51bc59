"""Every benchmark runs; how fast is measured by `make bench` alone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.__main__ import MODULES, QUICK
from tests.paths import ROOT


def test_every_benchmark_can_be_run_quickly() -> None:
    assert tuple(QUICK) == MODULES


@pytest.mark.long
@pytest.mark.parametrize("name", MODULES)
def test_a_benchmark_runs_and_prints_its_table(name: str, tmp_path: Path) -> None:
    environment = os.environ | {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    command = [sys.executable, "-m", "benchmarks", name, "--quick"]
    done = subprocess.run(
        command,
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        start_new_session=True,
    )
    assert done.returncode == 0, done.stderr
    assert "| what | measured | at most | | note |\n|---|---:|---:|---|---|\n| " in done.stdout
