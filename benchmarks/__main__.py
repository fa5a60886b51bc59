"""`make bench`: runs every benchmark, prints a table, and with --write puts it into docs/benchmarks.md."""

from __future__ import annotations

import argparse
import importlib
import os
import platform
from pathlib import Path
from typing import Any

MODULES = (
    "start",
    "decide",
    "native",
    "compile_time",
    "proof",
    "front_end",
    "typing",
    "functions",
    "explain",
    "simulation",
    "physics",
    "vision",
    "transport",
    "data_server",
    "data_limits",
    "processes",
    "load",
    "reading_to_motion",
    "hand_to_motion",
    "stops_on_wire",
    "one_line",
    "bag",
    "experiment",
)
QUICK: dict[str, dict[str, Any]] = {
    "start": {"RUNS": 1},
    "decide": {"SIZES": (10,), "ROUNDS": 1},
    "native": {"SIZES": (10,), "ROUNDS": 1, "BATCH_NS": 1000, "MODULES": 20},
    "compile_time": {"SIZES": (100,), "GRAPH_SIZES": (100,), "LEAST_RUNS": 1, "LEAST_SECONDS": 0.0},
    "proof": {
        "SECONDS": {100: 0.3},
        "FILES": ("behaviors/figure_4_14.colony",),
        "CHAINS": ((10, 2, 2, 1.0),),
    },
    "front_end": {"MODULES": 100},
    "typing": {"BLOCKS": 5, "KEYS": 2, "PACE_S": 0.0, "HOUR": 20},
    "functions": {"MODULES": 20, "ROUNDS": 1},
    "explain": {"MINUTES": 1, "MOMENTS_S": (1.0,)},
    "simulation": {"REPEATS": 1},
    "physics": {"MINUTE_S": 1.0, "HOUR_S": 2.0, "POSES": 1, "SEEDS": (1,)},
    "vision": {"ROUNDS": 1, "BATCH": 1},
    "transport": {"ROUNDS": 1, "CALLS": 20, "CALLS_OF_MANY": 5, "CLIENTS": 2},
    "data_server": {"SETS": 20, "GETS": 20, "WARM": 5, "CLIENTS": 2},
    "data_limits": {"ROUNDS": 1, "VARIABLES": 50},
    "processes": {
        "STARTS": 1,
        "FRAMES": 10,
        "WARM_UP": 2,
        "CROWD": 4,
        "CROWD_PROCESSES": 1,
        "CROWD_FRAMES": 5,
    },
    "load": {"ROUNDS": 1, "FRAMES": 5, "WARM_UP": 1, "BEHAVIORS": ("wander",)},
    "reading_to_motion": {"EVENTS": 2},
    "hand_to_motion": {"EVENTS": 2},
    "stops_on_wire": {"ROUNDS": 1, "WATCHED_S": 0.2, "PRESSES": 3},
    "one_line": {"SECONDS": 1.0, "SETTLE_S": 1.0},
    "bag": {"SECONDS": 2.0},
    "experiment": {"RUNS": 2, "SINGLE_RUNS": 1, "DURATION_S": 1},
}
"""With --quick: constants with which a benchmark takes about a second; its figures mean nothing."""

PAGE = Path(__file__).parent.parent / "docs" / "benchmarks.md"
MARK = "<!-- results -->"


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or "unknown"
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown")


def _machine() -> str:
    python = f"CPython {platform.python_version()}"
    return f"{_cpu()}, {os.cpu_count()} cores, {platform.system()} {platform.release()}, {python}"


def _shown(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _table(rows: list[dict[str, Any]]) -> list[str]:
    out = ["| what | measured | at most | | note |", "|---|---:|---:|---|---|"]
    for row in rows:
        target = "" if row["target"] is None else f"{_shown(row['target'])} {row['unit']}"
        verdict = "" if row["target"] is None else ("met" if row["ok"] else "**missed**")
        value = f"{_shown(row['value'])} {row['unit']}"
        out.append(f"| {row['name']} | {value} | {target} | {verdict} | {row['note']} |")
    return out


def _written(page: str, sections: dict[str, str]) -> str:
    """The page with these results; those of benchmarks that were not run stay."""
    text, _, results = page.partition(MARK)
    _, *kept = results.split("\n### ")
    known = {part.split("\n", 1)[0]: f"### {part.rstrip()}" for part in kept} | sections
    parts = [known[name] for name in MODULES if name in known]
    return f"{text}{MARK}\n\n" + "\n\n".join(parts) + "\n"


def _name(text: str) -> str:
    if text in MODULES:
        return text
    own = Path(__file__).parent / f"{text}.py"
    if text.isidentifier() and own.is_file() and "__main__" in own.read_text(encoding="utf-8"):
        raise argparse.ArgumentTypeError(f"`{text}` has no table; run it as python -m benchmarks.{text}")
    raise argparse.ArgumentTypeError(f"no benchmark `{text}`; expected one of {', '.join(MODULES)}")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", type=_name, help=f"which: {', '.join(MODULES)} (default: all)")
    parser.add_argument("--write", action="store_true", help="put the results into docs/benchmarks.md")
    parser.add_argument(
        "--quick", action="store_true", help="run each for about a second: whether it runs, not how fast"
    )
    arguments = parser.parse_args()
    if arguments.quick and arguments.write:
        parser.error("--quick measures nothing that could be written")
    sections: dict[str, str] = {}
    missed = 0
    for name in arguments.names or MODULES:
        module = importlib.import_module(f"benchmarks.{name}")
        for constant, value in QUICK[name].items() if arguments.quick else ():
            getattr(module, constant)  # an AttributeError if it has moved
            setattr(module, constant, value)
        print(f"\n{name}: {(module.__doc__ or '').splitlines()[0]}", flush=True)
        rows = module.run()
        missed += sum(1 for row in rows if row["target"] is not None and not row["ok"])
        table = _table(rows)
        print("\n".join(table), flush=True)
        about = (module.__doc__ or "").splitlines()[0]
        told = [f"### {name}", "", about, "", f"Measured on {_machine()}.", "", *table]
        sections[name] = "\n".join(told)
    print(f"\n{missed} targets missed; {_machine()}")
    if arguments.write:
        PAGE.write_text(_written(PAGE.read_text(encoding="utf-8"), sections), encoding="utf-8")


if __name__ == "__main__":
    main()
