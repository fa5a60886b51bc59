"""How long the passes take: random graphs of modules, and ladders with 2 ** n ways through them.

Ten times the modules may take thirteen times as long, which leaves room for what a processor's caches do to
large networks; anything quadratic, or that expands shared wires, is far beyond. Every figure is the best of
a few runs of the same seeded network, garbage collection at rest between them as within compilation.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from time import process_time

from colony.compile.pipeline import compile_program
from colony.ir.program import Program
from tests.networks import chain, ladder, random_program

SEED = 1
SIZES = (1_000, 10_000)
GRAPH_SIZES = (*SIZES, 100_000)
LEAST_RUNS = 3
LEAST_SECONDS = 4.0
MOST_SECONDS = 2.0
MOST_GROWTH = 13.0

Row = dict[str, object]


def run() -> list[Row]:
    """One row a figure: name, value, unit, target (None: only told), ok, note."""
    rows = _growth("random graph", lambda n: random_program(n, SEED), GRAPH_SIZES, "modules")
    rows += _growth("ladder", ladder, SIZES, "rungs")
    rows += _growth("chain", chain, SIZES, "modules")
    return rows


def _growth(name: str, make: Callable[[int], Program], sizes: tuple[int, ...], unit: str) -> list[Row]:
    """Rows for the time at each size, and for each step from one to the next."""
    rows: list[Row] = []
    before = 0.0
    for at, size in enumerate(sizes):
        seconds, note = _best(make(size))
        target = MOST_SECONDS if size == 10_000 else None
        rows.append(_row(f"{name}, {size:,} {unit}", seconds, "s", target, note))
        if at:
            step = f"{sizes[at - 1]:,} to {size:,} {unit}"
            rows.append(_row(f"{name}, {step}", seconds / before, "times", MOST_GROWTH, ""))
        before = seconds
    return rows


def _best(program: Program) -> tuple[float, str]:
    best, runs, spent = float("inf"), 0, 0.0
    while runs < LEAST_RUNS or spent < LEAST_SECONDS:
        gc.collect()
        start = process_time()
        compilation = compile_program(program)
        seconds = process_time() - start
        best, runs, spent = min(best, seconds), runs + 1, spent + seconds
    clients = sum(len(one.clients) for one in compilation.clients.actuators)
    nodes, guards = len(compilation.network.nodes), len(compilation.clients.guards)
    return best, f"{nodes:,} nodes, {clients:,} clients, {guards:,} guards"


def _row(name: str, value: float, unit: str, target: float | None, note: str) -> Row:
    ok = target is None or value <= target
    return {"name": name, "value": value, "unit": unit, "target": target, "ok": ok, "note": note}


def main() -> None:
    """Print the table."""
    for row in run():
        target = "" if row["target"] is None else f"{row['target']:g}"
        verdict = "ok" if row["ok"] else "MISS"
        print(f"{row['name']:44} {row['value']:>9.4g} {row['unit']:5} {target:>4} {verdict:4} {row['note']}")


if __name__ == "__main__":
    main()
