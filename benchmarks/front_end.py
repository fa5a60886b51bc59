"""The front end: 10,000 modules from text."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
MODULES = 10_000


def program_text(modules: int) -> str:
    """A program of so many modules in strict priority over an array of 1,000 numbers."""
    lines = [
        "robot r {",
        "  sensor s[1000] : number from DServer.S",
        "  actuator drive { velocity : mm/s, turn : deg/s }",
        "           to RServer.drive idle drive(velocity = 0, turn = 0)",
        "}",
    ]
    for i in range(modules):
        other = i * 7 % 1000
        lines.append(f"module m{i} {{\n  when s[{i % 1000}] < 0.5")
        lines.append(f"  do drive(velocity = {i} mm/s, turn = s[{other}] * 3 deg/s)\n}}")
    wiring = " suppresses ".join(f"m{i}" for i in range(modules))
    return "\n".join([*lines, "network {", f"  drive = {wiring}", "}\n"])


_FROM_TEXT = """
import sys, time
from pathlib import Path
from benchmarks.front_end import program_text
from colony.dsl.load import load_text
from colony.compile.pipeline import compile_program
text = program_text(int(sys.argv[1]))
start = time.perf_counter()
program = load_text(text)
middle = time.perf_counter()
compile_program(program)
end = time.perf_counter()
# Of this process alone: what getrusage tells is inherited from the one that started it.
peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
print(middle - start, end - middle, int(peak.split()[1]) / 1024)
"""


def run() -> list[dict[str, Any]]:
    """Rows of name, value, unit, target, ok, note."""
    done = subprocess.run(
        [sys.executable, "-c", _FROM_TEXT, str(MODULES)], cwd=ROOT, capture_output=True, text=True, check=True
    )
    front, passes, memory = (float(word) for word in done.stdout.split())
    return [
        _row(f"{MODULES:,} modules from text to clients", front + passes, "s", 10.0, ""),
        _row(f"{MODULES:,} modules, the passes", passes, "s", 2.0, ""),
        _row(f"{MODULES:,} modules, memory at most", memory, "MB", 500.0, ""),
    ]


def _row(name: str, value: float, unit: str, target: float, note: str) -> dict[str, Any]:
    return {"name": name, "value": value, "unit": unit, "target": target, "ok": value <= target, "note": note}


if __name__ == "__main__":
    started = time.perf_counter()
    for row in run():
        print(row)
    print(f"{time.perf_counter() - started:.1f} s")
