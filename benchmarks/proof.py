"""How long proofs take: that compilation changed nothing, and all that `colony verify` does for a behavior.

Compilation is proved for chains, ladders with 2 ** n ways through them, and random graphs with inhibitors,
shared wires and time constants: network, client list and the code that clients run. Beside each time stands
how it compares with compiling the same program.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import perf_counter

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file
from colony.ir.program import Program
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import OverReals, Proved, ProvedInTime
from colony.verify.equivalence import prove, results
from colony.verify.lints import lint
from tests.networks import chain, ladder, random_program

SEED = 1
SECONDS = {100: 0.3, 1_000: 3.0, 10_000: 60.0}
SECONDS_FOR_A_BEHAVIOR = 10.0
FILES = ("behaviors/*.colony", "robots/*/*.colony")
ROOT = Path(__file__).parent.parent

Row = dict[str, object]


def run() -> list[Row]:
    """One row a figure: name, value, unit, target, ok, note."""
    rows = _compilation("chain", chain, "modules")
    rows += _compilation("ladder", ladder, "rungs")
    rows += _compilation("random graph", lambda n: random_program(n, SEED), "modules")
    rows += [
        _behavior(file)
        for file in sorted(
            [path for pattern in FILES for path in ROOT.glob(pattern)], key=lambda path: path.stem
        )
    ]
    return rows


def _compilation(name: str, make: Callable[[int], Program], unit: str) -> list[Row]:
    rows: list[Row] = []
    for size, most in SECONDS.items():
        program = make(size)
        gc.collect()
        start = perf_counter()
        compilation = compile_program(program)
        compiling = perf_counter() - start
        start = perf_counter()
        result = prove.prove(program, compilation, sent=partial(getattr, compilation, "compiled"))
        seconds = perf_counter() - start
        match result:
            case results.Proved(by_structure=by_structure, by_solver=by_solver):
                shown = f"{by_structure:,} obligations by structure, {by_solver:,} by z3"
                proved = True
            case _:
                shown, proved = f"not proved: {result}", False
        note = f"{shown}; {seconds / compiling:.1f} times as long as compiling"
        rows.append(_row(f"proof, {name}, {size:,} {unit}", seconds, most, note, proved))
    return rows


def _behavior(file: Path) -> Row:
    """Contracts and lints of a file."""
    program = load_file(file)
    gc.collect()
    start = perf_counter()
    verdicts = prove_contracts(program)
    warnings = lint(program)
    seconds = perf_counter() - start
    proved = [verdict for verdict in verdicts if isinstance(verdict, Proved | ProvedInTime)]
    over_reals = sum(1 for verdict in verdicts if isinstance(verdict, OverReals))
    counts = f"{len(proved)} of {len(verdicts)} contracts proved, {over_reals} over reals"
    note = f"{counts}; {len(warnings)} warnings"
    is_settled = len(proved) + over_reals == len(verdicts)
    return _row(f"verify, {file.name}", seconds, SECONDS_FOR_A_BEHAVIOR, note, is_settled)


def _row(name: str, seconds: float, most: float, note: str, proved: bool) -> Row:
    ok = proved and seconds <= most
    return {"name": name, "value": seconds, "unit": "s", "target": most, "ok": ok, "note": note}


def main() -> None:
    """Print the table."""
    for row in run():
        verdict = "ok" if row["ok"] else "MISS"
        print(f"{row['name']:40} {row['value']:>9.3g} s  {row['target']:>4} {verdict:4} {row['note']}")


if __name__ == "__main__":
    main()
