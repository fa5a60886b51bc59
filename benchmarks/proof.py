"""How long proofs take: that compilation changed nothing, and all that `colony verify` does for a program.

Compilation is proved for chains, ladders with 2 ** n ways through them, and random graphs with inhibitors,
shared wires and time constants: network, client list and the code that clients run. Beside each time stands
how it compares with compiling the same program.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from time import perf_counter

from colony.cli.verify.prover_options import DEFAULT_SECONDS
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file, load_text
from colony.ir.program import Program
from colony.text.wording import counted
from colony.verify.contracts import prove as contracts
from colony.verify.contracts.kept import ProofCache
from colony.verify.contracts.results import (
    RESOURCES_PER_SECOND,
    OverReals,
    ProofOptions,
    Proved,
    ProvedInTime,
    Unknown,
)
from colony.verify.equivalence import prove, results
from colony.verify.lints import Effort, lint
from colony.verify.symbolic.system import Shape
from tests.networks import chain, ladder, random_program

SEED = 1
SECONDS = {100: 0.3, 1_000: 3.0, 10_000: 60.0}
SECONDS_FOR_A_BEHAVIOR = 10.0
CHAINS = ((100, 1, 1, 0.6), (750, 200, 100, 15.0), (3_000, 200, 1, 90.0))
"""Modules of a chain, sensors, contracts, and seconds that verifying them may take."""
AGAIN = "navigator.colony"
MOST_AGAIN = 0.1
"""Seconds of verifying this behavior again, in multiples of the first time."""
FILES = ("behaviors/*.colony", "robots/*/*.colony")
ROOT = Path(__file__).parent.parent

Row = dict[str, object]


def run() -> list[Row]:
    """One row a figure: name, value, unit, target, ok, note."""
    rows = _compilation("chain", chain, "modules")
    rows += _compilation("ladder", ladder, "rungs")
    rows += _compilation("random graph", lambda n: random_program(n, SEED), "modules")
    files = sorted([path for pattern in FILES for path in ROOT.glob(pattern)], key=lambda path: path.stem)
    rows += [_alone(_verified, file.name, file, SECONDS_FOR_A_BEHAVIOR) for file in files]
    for modules, sensors, count, most in CHAINS:
        name = f"{modules:,} modules, {counted(sensors, 'sensor')}, {counted(count, 'contract')}"
        rows.append(_alone(_verified, name, _text(modules, sensors, count), most))
    return [*rows, *(_alone(_again, file) for file in files if file.name == AGAIN)]


def _alone(row: Callable[..., Row], *arguments: object) -> Row:
    """Return a row that is measured in a process of its own: z3 is slower where it has done much before."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        return process.submit(row, *arguments).result()


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
            case results.EquivalenceProved(by_structure=by_structure, by_solver=by_solver):
                shown = f"{by_structure:,} obligations by structure, {by_solver:,} by z3"
                proved = True
            case _:
                shown, proved = f"not proved: {result}", False
        note = f"{shown}; {seconds / compiling:.1f} times as long as compiling"
        rows.append(_row(f"proof, {name}, {size:,} {unit}", seconds, most, note, proved))
    return rows


def _verified(name: str, text: str | Path, most: float) -> Row:
    """Contracts and lints of a program: its text, or a file."""
    program = load_file(text) if isinstance(text, Path) else load_text(text)
    gc.collect()
    start = perf_counter()
    shapes = dict[str, Shape]()
    verdicts = list(contracts.results(program, [c.name for c in program.contracts], None, shapes))
    effort = Effort(round(2 * DEFAULT_SECONDS * RESOURCES_PER_SECOND))
    warnings = lint(program, effort, shapes)
    seconds = perf_counter() - start
    proved = sum(isinstance(verdict, Proved | ProvedInTime) for verdict in verdicts)
    over_reals, unknown = (sum(isinstance(v, kind) for v in verdicts) for kind in (OverReals, Unknown))
    counts = f"{proved} of {len(verdicts)} contracts proved, {over_reals} over reals, {unknown} unknown"
    note = f"{counts}; {counted(len(warnings), 'warning')}"
    return _row(f"verify, {name}", seconds, most, note, unknown == 0)


def _text(modules: int, sensors: int, count: int) -> str:
    """Return a chain of modules, each with a threshold for one of the sensors."""
    drawn, names = Random(SEED), [f"m{i}" for i in range(modules)]
    return "\n".join(
        [
            "language 1",
            "robot r {",
            *(f"  sensor s{i} : mm range 0 .. 10000 from P{i % 20}Server.s{i}" for i in range(sensors)),
            "  actuator drive { velocity : mm/s range -600 .. 600 }",
            "           to RServer.drive idle drive(velocity = 0)",
            "}",
            *(
                f"module m{i} {{ when s{i % sensors} < {drawn.randint(1, 4000)} mm "
                f"do drive(velocity = {drawn.randint(-500, 500)} mm/s) }}"
                for i in range(modules)
            ),
            f"network {{ drive = {' suppresses '.join(names)} }}",
            *(
                f"contract c{i}: s{i % sensors} < {drawn.randint(1, 4000)} mm implies "
                f"drive.velocity <= {drawn.randint(400, 600)} mm/s"
                for i in range(count)
            ),
            "",
        ]
    )


def _again(file: Path) -> Row:
    """Contracts of a file that were proved before."""
    program = load_file(file)
    seconds = []
    with TemporaryDirectory() as folder:
        for _ in range(2):
            gc.collect()
            start = perf_counter()
            cache = ProofCache(Path(folder), program, ProofOptions(), [c.name for c in program.contracts])
            found = list(contracts.results(program, [c.name for c in program.contracts], cache=cache))
            seconds.append(perf_counter() - start)
    ratio, note = seconds[1] / seconds[0], f"{len(found)} contracts, {seconds[1]:.2g} s"
    name, ok = f"verify, {file.name}, again", ratio <= MOST_AGAIN
    return {"name": name, "value": ratio, "unit": "times", "target": MOST_AGAIN, "ok": ok, "note": note}


def _row(name: str, seconds: float, most: float, note: str, proved: bool) -> Row:
    ok = proved and seconds <= most
    return {"name": name, "value": seconds, "unit": "s", "target": most, "ok": ok, "note": note}


def main() -> None:
    """Print the table."""
    for row in run():
        verdict = "ok" if row["ok"] else "MISS"
        figure = f"{row['value']:>9.3g} {row['unit']:5} {row['target']:>4} {verdict:4}"
        print(f"{row['name']:50} {figure} {row['note']}")


if __name__ == "__main__":
    main()
