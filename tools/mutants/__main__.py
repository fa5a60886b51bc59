"""python -m tools.mutants: mutants of the compiler, frames and arbitration, and what kills them."""

from __future__ import annotations

import argparse
import os
import random
from pathlib import Path

from tools.mutants import baseline, reasons, report
from tools.mutants.baseline import Baseline
from tools.mutants.hunt import Hunt, hunt
from tools.mutants.mutation import Mutant, mutants_of
from tools.mutants.results import Results
from tools.mutants.scope import ROOT, digest, modules, tests

CACHE = ROOT / "build" / "mutants"


def main() -> None:
    options = _options()
    known = modules()
    todo = {path: _sampled(mutants_of(ROOT, path), options.sample) for path in options.modules or known}
    helpers = [path for path in _tests() if not path.name.startswith("test_")]
    file = CACHE / f"baseline-{digest(*helpers, *ROOT.glob('colony/**/*.py'))}.json"
    known_tests = baseline.measured(tests(), known, file)
    results = Results(CACHE / "results.jsonl", known, digest(*_tests()), options.budget, reasons.load())
    left = {path: [m for m in mutants if not results.has(m)] for path, mutants in todo.items()}
    count, new = sum(map(len, todo.values())), sum(map(len, left.values()))
    print(f"{count} mutants, {count - new} known, {new} to try", flush=True)
    _in_parallel(left, known_tests, results, options.budget, options.workers)
    results.reload()
    _tell(todo, results)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, prog="python -m tools.mutants")
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="only these modules (paths)")
    parser.add_argument("--sample", type=int, metavar="N", help="only N mutants a module, drawn with seed 0")
    parser.add_argument("--budget", type=float, default=10.0, metavar="S", help="seconds of tests a mutant")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes that try mutants")
    return parser.parse_args()


def _tests() -> list[Path]:
    """Return all files of tests, and of the tools that they use."""
    paths = (path for folder in ("tests", "tools") for path in ROOT.glob(f"{folder}/**/*.py"))
    return [path for path in paths if path.parent != Path(__file__).parent]


def _sampled(mutants: list[Mutant], size: int | None) -> list[Mutant]:
    if size is None or size >= len(mutants):
        return mutants
    return random.Random(0).sample(mutants, size)


def _in_parallel(
    left: dict[str, list[Mutant]], known: Baseline, results: Results, budget: float, workers: int
) -> None:
    """Each worker takes modules of its own, the large ones dealt first."""
    shares: list[dict[str, list[Mutant]]] = [{} for _ in range(workers)]
    for path in sorted(left, key=lambda path: -len(left[path])):
        min(shares, key=lambda share: sum(map(len, share.values())))[path] = left[path]
    children = []
    for share in shares:
        child = os.fork()
        if not child:
            try:
                hunt(Hunt(share, tests(), known, results, budget))
            except BaseException as problem:
                print(f"{type(problem).__name__}: {problem}", flush=True)
                os._exit(1)
            os._exit(0)
        children.append(child)
    codes = [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children]
    if any(codes):
        raise SystemExit("not all mutants were tried")


def _tell(todo: dict[str, list[Mutant]], results: Results) -> None:
    table = report.rows(todo, results)
    print(report.plain(report.HEADER, [row.cells for row in table]))
    surviving, known = report.survivors(todo, results), reasons.load()
    unexplained = [mutant for mutant in surviving if known.why(mutant) is None]
    print(f"\n{len(surviving)} survive, {len(surviving) - len(unexplained)} of them explained")
    for mutant in unexplained:
        print(f"  {mutant.path}:{mutant.line}: {mutant.key}")
    for line in known.stale(surviving, [m for several in todo.values() for m in several]):
        print(f"  explained, but not a survivor: {line}")


if __name__ == "__main__":
    main()
