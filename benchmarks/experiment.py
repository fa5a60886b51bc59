"""Experiments: many runs of `colony experiment` against as many of `colony run`, and over two workers."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).parent.parent
RUNS = 20
SINGLE_RUNS = 5
DURATION_S = 60
SCALED_TO = 1000


def run() -> list[dict[str, Any]]:
    """Rows of name, value, unit, target, ok, note."""
    setting = ("wander", "--robot", "amr", "--map", "office", "--duration", str(DURATION_S))
    with TemporaryDirectory() as folder:
        _timed(folder, "run", *setting, "--no-picture")  # compiles the simulator
        single = sum(
            _timed(folder, "run", *setting, "--no-picture", "--seed", str(seed))
            for seed in range(1, SINGLE_RUNS + 1)
        )
        experiment = ("experiment", *setting, "--vary", "start", "--runs", str(RUNS))
        two = _timed(folder, *experiment, "--workers", "2")
        one = _timed(folder, *experiment, "--workers", "1")
    a_run, an_experiment = single / SINGLE_RUNS, two / RUNS
    name = f"{SCALED_TO:,} runs of {DURATION_S} s, amr in office"
    note = f"{RUNS} runs took {two:.1f} s, {SINGLE_RUNS} of `colony run` {single:.1f} s"
    return [
        _row(f"{name}: experiment with 2 workers", an_experiment * SCALED_TO / 60.0, "min", note),
        _row(f"{name}: `colony run` each, one after another", a_run * SCALED_TO / 60.0, "min", "scaled"),
        _row("`colony run` each / experiment with 2 workers", a_run / an_experiment, "x", ""),
        _row("experiment with 1 worker / with 2 workers", one / two, "x", f"{RUNS} runs"),
    ]


def _timed(folder: str, *arguments: str) -> float:
    start = time.perf_counter()
    command = [sys.executable, "-m", "colony", *arguments]
    subprocess.run(command, cwd=folder, capture_output=True, check=True)
    return time.perf_counter() - start


def _row(name: str, value: float, unit: str, note: str) -> dict[str, Any]:
    return {"name": name, "value": value, "unit": unit, "target": None, "ok": True, "note": note}
