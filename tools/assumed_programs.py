"""Proofs under assumptions of drawn programs, held to runs that meet the assumptions.

`python -m tools.assumed_programs --proofs 500` appends a few assumptions to drawn programs, about their
sensors and lets, and contracts that may need them. What is proved under some of them must hold in runs of
1,000 frames and in drawn ones, with clients late and operators where the verdict says so, up to the frame in
which one of these is broken. A run that refutes a contract must break no assumption.
Tests that are generated for coverage must break none either, and no drawn run up to a broken one may show
what coverage says is impossible while they hold.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from random import Random

from colony.dsl.load import load_text
from colony.ir.frame import Outcome
from colony.ir.program import Let, Program, Sensor, assumptions
from colony.ir.types import Array, Bool, Quantity
from colony.verify.contracts.concrete_runs import GeneratedRuns, Replay, long_run, with_stand_ins
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import ProofOptions, Proved, ProvedInTime, Refuted
from colony.verify.lints.proof import has_python_modules
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import ALL_EXECUTORS, disagreement
from colony.verify.testing.frames import Choices, draw_trace
from colony.verify.testing.guided import disturbed_run
from tests.drawn.strategies import run_of_seed
from tools.drawn_programs import coverage_findings

_OPTIONS = ProofOptions(depth=2, max_frames=4, resources=300_000)
_ASSUMPTIONS = 3
_LONG_RUNS = 10
_TRACES = 6
_FRAMES = 12

Counts = Counter[str]


def assumed_program(seed: int) -> Program:
    """Return a drawn program with a few assumptions, and contracts that may rest on them."""
    program, _ = run_of_seed(seed)
    random = Random(f"assumptions {seed}")
    lines = [*_about_sensors(program, random), *_about_lets(program)]
    chosen = random.sample(lines, min(_ASSUMPTIONS, len(lines)))
    actuator = program.robot.actuators[0].name
    text = [program.files[-1][1].text]
    for i, (expression, *claims) in enumerate(chosen):
        text.append(f"assume assumed_{i}: {expression}")
        text.append(f"contract idle_{i}: not broken(assumed_{i}) or {actuator} is idle")
        text += [f"contract claim_{i}_{j}: {claim}" for j, claim in enumerate(claims)]
    return load_text("\n".join(text))


def _about_sensors(program: Program, random: Random) -> Iterator[tuple[str, ...]]:
    """Yield what may be assumed of sensors, each with what may follow from it."""
    for sensor in program.robot.sensors:
        name = sensor.name
        if not sensor.of_robot or isinstance(sensor.type, Array):
            continue
        if isinstance(sensor.type, Bool):
            yield f"not {name}", f"not recently(value_or({name}, false), 1 s)"
        elif isinstance(sensor.type, Quantity):
            high, more = (f"{x} {sensor.unit}" for x in _two_bounds(sensor, random))
            fell = f"previous({name}, {name}) - {name}"
            yield f"{name} <= {high}", f"value_or({name} < {more}, true)"
            yield f"value_or({fell} <= {high}, true)", f"value_or({fell} <= {more}, true)"
            yield f"fresh({name})", f"fresh({name}) and previous(fresh({name}), true)"


def _two_bounds(sensor: Sensor, random: Random) -> tuple[float, float]:
    """Return two bounds in the unit of a sensor, the second above the first."""
    low = 0.0 if sensor.low is None else sensor.low / sensor.factor
    high = 100.0 if sensor.high is None else sensor.high / sensor.factor
    first = round(abs(low + (high - low) * random.choice((0.25, 0.5, 0.75))), 3)
    return first, 2 * first + 1


def _about_lets(program: Program) -> Iterator[tuple[str, ...]]:
    for let in program.derived:
        if isinstance(let, Let) and isinstance(let.expression.type, Bool) and "." not in let.name:
            yield let.name, f"value_or({let.name}, true)"
            yield f"not {let.name}", f"not value_or({let.name}, false)"


def check(seed: int) -> tuple[Counts, list[str]]:
    """Return how much was compared of a drawn program, and what is wrong."""
    program = assumed_program(seed)
    found = disagreement(program, draw_trace(Choices(Random(seed)), program, _FRAMES), ALL_EXECUTORS)
    findings = [] if found is None else [f"seed {seed}: {found}"]
    counts, proved = Counter(programs=1), list[Proved | ProvedInTime]()
    if not has_python_modules(program):
        of_coverage, wrong = coverage_findings(seed, program)
        counts["obligations"] += of_coverage["obligations"]
        counts["impossible while they hold"] += of_coverage["impossible under assumptions"]
        findings += wrong
    for result in prove_contracts(program, _OPTIONS):
        match result:
            case Proved() | ProvedInTime() if result.contract.assuming:
                proved.append(result)
                counts["proofs"] += 1
                counts[f"resting on {len(result.contract.assuming)}"] += 1
            case Refuted(trace=trace):
                counts["refuted"] += 1
                if any(Replay(program, a.name).breaks(trace.snapshots) for a in assumptions(program)):
                    findings.append(f"seed {seed}: what refutes {result.contract.name} breaks an assumption")
                if not Replay(program, result.contract.name).breaks(trace.snapshots):
                    findings.append(f"seed {seed}: what refutes {result.contract.name} does not break it")
            case _:
                pass
    for kind, covered, outcomes in _runs(seed, program, proved) if proved else ():
        findings += [f"seed {seed}: {kind} breaks {name}" for name in _broken(covered, outcomes, counts)]
    return counts, findings


def _runs(
    seed: int, program: Program, proved: list[Proved | ProvedInTime]
) -> Iterator[tuple[str, Sequence[Proved | ProvedInTime], Iterable[Outcome]]]:
    """Yield runs, each with the proofs that are about it."""
    late = [r for r in proved if isinstance(r, Proved) and not r.contract.in_time]
    operators = [r for r in late if r.operators]
    stands_in = with_stand_ins(program)
    runs = GeneratedRuns(stands_in)
    for number in range(_LONG_RUNS):
        yield f"long run {number}", proved, runs.outcomes(long_run(stands_in, number))
    for number in range(_TRACES):
        choices = Choices(Random(f"{seed}/{number}"))
        trace = draw_trace(choices, program, _FRAMES)
        yield f"trace {number}", proved, map(Interpreter(program).step, trace)
        for covered, with_operators in ((late, False), (operators, True)):
            disturbed = disturbed_run(choices, program, trace, operators=with_operators)
            yield f"trace {number}, disturbed", covered, (frame.outcome for frame in disturbed)


def _broken(
    proved: Sequence[Proved | ProvedInTime], outcomes: Iterable[Outcome], counts: Counts
) -> Iterator[str]:
    """Yield the contracts that a run breaks before it breaks an assumption that their proofs rest on."""
    broken = set[str]()
    for outcome in outcomes:
        broken |= set(outcome.breaches)
        held = [r for r in proved if not broken.intersection(r.contract.assuming)]
        if not held:
            return
        counts["frames that meet them"] += 1
        yield from (r.contract.name for r in held if r.contract.name in outcome.breaches)


def main() -> int:
    """Check drawn programs until there are enough proofs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--proofs", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    given = parser.parse_args()
    total, findings, seed = Counts(), list[str](), given.seed
    while total["proofs"] < given.proofs:
        counts, found = check(seed)
        total.update(counts)
        findings += found
        seed += 1
    print(
        ", ".join(f"{count:,} {what}" for what, count in sorted(total.items())), f"; {len(findings)} findings"
    )
    print("\n".join(findings))
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
