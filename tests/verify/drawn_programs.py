"""What is proved, and what is computed, of drawn programs, held to the reference interpreter.

`python -m tests.verify.drawn_programs --programs 20000 --contracts 5000` (`make agreement`) compares all
executors over drawn traces, then, for contracts, the formulas with the interpreter frame by frame, and what
`verify` says with what drawn traces show. Sensors fail in many frames.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from multiprocessing import Pool
from random import Random

from colony.verify.contracts.prove import Prover
from colony.verify.contracts.replay import Replay
from colony.verify.contracts.results import Options, Proved, Refuted
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import ALL_EXECUTORS, disagreement
from colony.verify.testing.drawing import Choices
from colony.verify.testing.frames import draw_trace
from colony.verify.testing.strategies import run_of_seed
from tests.verify.symbolic.trust import held_against

_OPTIONS = Options(depth=2, max_frames=4, resources=300_000)
_TRACES = 6
_FRAMES = 12

Counts = Counter[str]
Findings = tuple[Counts, list[str]]
Check = Callable[[int], Findings]


def executors(seed: int, network: bool) -> Findings:
    """Compare all executors with the interpreter over one drawn trace."""
    program, trace = run_of_seed(seed, network=network)
    found = disagreement(program, trace, ALL_EXECUTORS)
    counts = Counter(programs=1, frames=len(trace))
    return counts, [] if found is None else [f"seed {seed}: {found}"]


def formulas(seed: int) -> Findings:
    """Compare the encoding with the interpreter over one drawn trace, contracts included."""
    program, trace = run_of_seed(seed)
    tally = held_against(program, trace)
    counts = Counter(contracts=len(program.contracts), values=tally.exact + tally.within, open=tally.open)
    return counts, [f"seed {seed}: {difference}" for difference in tally.differences]


def verdicts(seed: int) -> Findings:
    """Break what is proved by drawn traces, and replay what is refuted."""
    program, _ = run_of_seed(seed)
    prover = Prover(program, _OPTIONS, lambda: 0.0)
    results = {contract.name: prover.prove(contract) for contract in program.contracts}
    counts = Counter(type(result).__name__.lower() for result in results.values())
    findings, proved = [], set[str]()
    for name, result in results.items():
        match result:
            case Proved(over_reals=()):
                proved.add(name)
            case Refuted(trace=trace):
                counts["refuted by an unknown value"] += trace.unknown
                if Replay(program, name).breach(trace.snapshots) is None:
                    findings.append(f"seed {seed}: the run that refutes {name} does not break it")
            case _:
                pass
    for number in range(_TRACES if proved else 0):
        interpreter = Interpreter(program)
        for frame in draw_trace(Choices(Random(f"{seed}/{number}")), program, _FRAMES):
            broken = proved.intersection(interpreter.step(frame).breaches)
            findings += [f"seed {seed}: trace {number} breaks {name}, which is proved" for name in broken]
    return counts, findings


def run(name: str, check: Check, seeds: range, workers: int) -> bool:
    """Run a check of every seed, print the counts and all findings, and return True if there are none."""
    total, findings = Counts(), list[str]()
    with Pool(workers) as pool:
        for counts, found in pool.imap_unordered(check, seeds, chunksize=20):
            total.update(counts)
            findings += found
    shown = ", ".join(f"{count:,} {what}" for what, count in sorted(total.items()))
    print(f"{name}: seeds {seeds.start} to {seeds.stop - 1}: {shown}; {len(findings)} findings", flush=True)
    for finding in findings:
        print(finding)
    return not findings


def main() -> int:
    """Run all checks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", type=int, default=20_000, help="programs for the executors")
    parser.add_argument("--contracts", type=int, default=5_000, help="programs for contracts")
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    whole = range(given.seed, given.seed + given.programs // 2)
    some = range(given.seed, given.seed + given.contracts)
    checks: Iterator[tuple[str, Check, range]] = iter(
        (
            ("executors, whole programs", partial(executors, network=False), whole),
            ("executors, networks", partial(executors, network=True), whole),
            ("formulas", formulas, some),
            ("verdicts", verdicts, some),
        )
    )
    results = [run(name, check, seeds, given.workers) for name, check, seeds in checks]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
