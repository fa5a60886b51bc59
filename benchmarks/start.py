"""Start-up: `import colony`, what it loads, and `colony check` against `python -c pass`."""

from __future__ import annotations

import compileall
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

ROOT = Path(__file__).parent.parent
RUNS = 25
HEAVY = ("lark", "numpy", "z3", "zenoh")

_IMPORT = f"""
import sys, time
before, start = len(sys.modules), time.perf_counter()
import colony
seconds = time.perf_counter() - start
print(seconds, len(sys.modules) - before, *(name for name in {HEAVY} if name in sys.modules))
"""
NOTHING = [sys.executable, "-c", "pass"]
IMPORT = [sys.executable, "-c", _IMPORT]
CHECK = [sys.executable, "-m", "colony.cli.main", "check", "behaviors/wander.colony"]


def run() -> list[dict[str, Any]]:
    """Rows of name, value, unit, target, ok, note."""
    compileall.compile_dir(ROOT / "colony", quiet=1)  # as `make` does when it installs
    _timed(CHECK)  # and once, so that no run waits for the disk
    nothing, check, imports = [], [], []
    for _ in range(RUNS):
        nothing.append(_timed(NOTHING)[0])
        check.append(_timed(CHECK)[0])
        imports.append(_timed(IMPORT)[1].split())
    milliseconds = median(float(words[0]) for words in imports) * 1e3
    note = f"medians of {RUNS}: {median(check) * 1e3:.0f} ms, against {median(nothing) * 1e3:.1f} ms"
    loaded = imports[0][2:]
    return [
        _row("import colony", milliseconds, "ms", 30.0, f"median of {RUNS}; {imports[0][1]} modules"),
        _row(f"import colony, of {', '.join(HEAVY)}", len(loaded), "loaded", 0.0, ", ".join(loaded)),
        _row("colony check wander / python -c pass", median(check) / median(nothing), "x", 8.0, note),
    ]


def _timed(arguments: list[str]) -> tuple[float, str]:
    """How long a process takes, in seconds, and what it prints."""
    start = time.perf_counter()
    done = subprocess.run(arguments, cwd=ROOT, capture_output=True, text=True, check=True)
    return time.perf_counter() - start, done.stdout


def _row(name: str, value: float, unit: str, target: float, note: str) -> dict[str, Any]:
    return {"name": name, "value": value, "unit": unit, "target": target, "ok": value <= target, "note": note}
