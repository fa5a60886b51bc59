"""What is proved, and what is computed, of drawn programs, held to the reference interpreter.

`python -m tools.drawn_programs --programs 20000 --contracts 5000` (`make agreement`) compares all
executors over drawn traces, also for programs with sequences and for programs written with functions and
inputs, then, for contracts, the formulas with the interpreter frame by frame, and what `verify` says with
what drawn traces show. Sensors fail in many frames. Tests that `coverage` generates must show what they say,
and no drawn run what it says is impossible.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from multiprocessing import Pool
from random import Random
from typing import NamedTuple

from colony.dsl.check.compatibility import with_new_cells
from colony.dsl.load import load_text
from colony.ir import expression as ir
from colony.ir.frame import Frame, Outcome
from colony.ir.program import Actuator, Contract, Module, Program, assumptions, without_assumed
from colony.ir.types import BOOL
from colony.ir.walk import all_subexpressions
from colony.verify.claims import TRUE, any_of, binary, constant, implies, negation
from colony.verify.contracts.concrete_runs import LongRuns, Replay
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import ProofOptions, Proved, ProvedInTime, Refuted
from colony.verify.coverage.generator import generate
from colony.verify.coverage.measure import GoalProver, Measured, covered_by, measure
from colony.verify.coverage.obligations import CoveragePlan, plan_of
from colony.verify.coverage.recorder import seen_in
from colony.verify.lints.contracts import premise
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import disagreement, with_c
from colony.verify.testing.examples import run_examples
from colony.verify.testing.frames import Choices, draw_trace, snapshots_of
from colony.verify.testing.guided import disturbed_run
from tests.drawn.program_text import draw_text
from tests.drawn.strategies import run_of_seed
from tests.drawn.tunables import with_tunables
from tests.verify.symbolic.trust import held_against
from tools.outlining import outlined_disagreement
from tools.written_out import drawn_disagreement

_OPTIONS = ProofOptions(depth=2, max_frames=4, resources=300_000)
_TRACES = 6
_FRAMES = 12
_SEQUENCE_FRAMES = 24
_MORE_CONTRACTS = 3

Counts = Counter[str]
Findings = tuple[Counts, list[str]]
Check = Callable[[int], Findings]


def _drawn(seed: int, tunable: bool) -> tuple[Program, tuple[Frame, ...]]:
    """Return a drawn program and a trace; with `tunable`, some of its number sensors are tunable params."""
    program, trace = run_of_seed(seed)
    return (with_tunables(program, Random(f"tunables {seed}")) if tunable else program), trace


def executors(seed: int, *, network: bool = False, tunable: bool = False) -> Findings:
    """Compare all executors with the interpreter over one drawn trace."""
    program, trace = run_of_seed(seed, network=True) if network else _drawn(seed, tunable)
    found = disagreement(program, trace, with_c(program))
    counts = Counter(programs=1, frames=len(trace))
    return counts, [] if found is None else [f"seed {seed}: {found}"]


def sequences(seed: int) -> Findings:
    """Compare all executors over a trace of a program with a sequence, and with it written out."""
    program, trace = run_of_seed(seed, max_frames=_SEQUENCE_FRAMES, sequence=True)
    found = (disagreement(program, trace, with_c(program)), drawn_disagreement(program, trace))
    findings = [f"seed {seed}: {finding}" for finding in found if finding is not None]
    return Counter(programs=1, frames=len(trace)), findings


def outlined(seed: int) -> Findings:
    """Compare a program with functions and inputs with the same program without, in all executors."""
    found = outlined_disagreement(seed)
    return Counter(programs=1), [] if found is None else [found]


def formulas(seed: int) -> Findings:
    """Compare the encoding with the interpreter over one drawn trace, contracts included."""
    program, trace = run_of_seed(seed)
    tally = held_against(program, trace)
    counts = Counter(contracts=len(program.contracts), values=tally.exact + tally.within, open=tally.open)
    return counts, [f"seed {seed}: {difference}" for difference in tally.differences]


def verdicts(seed: int, *, tunable: bool = False) -> Findings:
    """Break what is proved by drawn traces, and replay what is refuted."""
    program = with_weaker_contracts(_drawn(seed, tunable)[0], Random(seed))
    results = {result.contract.name: result for result in prove_contracts(program, _OPTIONS)}
    counts = Counter(type(result).__name__.lower() for result in results.values())
    findings, proved = list[str](), Holding(set(), set(), set())
    for name, result in results.items():
        match result:
            case Proved(operators=operators):
                counts["proved with operators"] += operators
                proved.always.add(name)
                proved.late.add(name)
                proved.operators.update({name} if operators else ())
            case ProvedInTime():
                proved.always.add(name)
                findings += _not_late(seed, program, result)
            case Refuted(trace=trace):
                counts["refuted by an unknown value"] += trace.unknown
                if Replay(program, name).breach(trace.snapshots) is None:
                    findings.append(f"seed {seed}: the run that refutes {name} does not break it")
            case _:
                pass
    return counts, [*findings, *_broken(seed, program, proved)]


class Holding(NamedTuple):
    """The contracts that are proved: while no client is late, while some are, and with operators besides."""

    always: set[str]
    late: set[str]
    operators: set[str]


def with_weaker_contracts(program: Program, random: Random) -> Program:
    """Return a program with a few contracts that hold more often than those that were drawn."""
    cells = count(
        1 + max((x.cell for x in all_subexpressions(program) if isinstance(x, ir.MemoryCall)), default=0)
    )
    idle = [ir.IsIdle(type=BOOL, actuator=a.name) for a in program.robot.actuators]
    active = [ir.IsActive(type=BOOL, name=m.name) for m in program.modules if isinstance(m, Module)]
    weaker = [
        Contract(
            name=f"{c.name}_or_{kind}",
            expression=any_of((with_new_cells(c.expression, lambda: next(cells)), other)),
        )
        for c in program.contracts
        for kind, other in (("idle", idle[0]), ("none_idle", negation(idle[-1])), ("active", active[-1]))
    ]
    bounds = [
        Contract(name=f"bounds_{a.name}_{i}", expression=_in_range(a, i))
        for a in program.robot.actuators
        for i, f in enumerate(a.fields)
        if a.idle is not None and f.low is not None
    ]
    both = [
        Contract(name=f"both_{a.actuator}_{b.actuator}", expression=any_of((a, negation(b))))
        for a in idle
        for b in idle
        if a != b
    ]
    more = [*weaker, *bounds, *both]
    chosen = random.sample(more, min(_MORE_CONTRACTS, len(more)))
    return replace(program, contracts=(*program.contracts, *chosen))


def _in_time(program: Program) -> Program:
    """Return the program with all contracts `in time`, and no client that can be lost apart."""
    robot = program.robot
    actuators = tuple(replace(a, on_loss="stop") for a in robot.actuators)
    contracts = tuple(replace(c, in_time=True) for c in program.contracts)
    return replace(program, robot=replace(robot, actuators=actuators), contracts=contracts)


def _in_range(actuator: Actuator, i: int) -> ir.Expression:
    field = actuator.fields[i]
    sent = ir.SentField(type=field.type, actuator=actuator.name, field_index=i)
    low = min(field.low or 0.0, float((actuator.idle or (0.0,) * (i + 1))[i]))
    return binary(ir.Binary.LESS_EQUAL, constant(low, field.type), sent)


def coverage(seed: int) -> Findings:
    """Run the tests that are generated for a drawn program, and look for what is proved never to be seen."""
    return coverage_findings(seed, load_text(draw_text(Choices(Random(seed)), python=False)))


def coverage_findings(seed: int, program: Program) -> Findings:
    """Return how much the coverage of a program was compared, and what is wrong with it."""
    plan = plan_of(_with_true_contracts(program))
    measured = measure(plan, set(), 0, GoalProver(plan))
    counts = Counter(programs=1, obligations=len(measured.measured), **measured.counts())
    counts["impossible under assumptions"] = sum(bool(m.assuming) for m in measured.measured)
    generated = generate(measured, set())
    text = "\n".join([program.files[-1][1].text, *(test.text for test in generated.tests)])
    written = _with_true_contracts(load_text(text))
    counts["tests"] = len(generated.tests)
    findings = [f"{r.name} fails" for r in run_examples(written) if not r.passed]
    shown = set[str]()
    for example, test in zip(written.tests[len(program.tests) :], generated.tests, strict=True):
        shown |= seen_in(plan, snapshots_of(written, example))
        findings += [f"{test.title}: no {goal}" for goal in test.goals - shown]
    left_out = {m.obligation for m in generated.left_out}
    for m in measured.measured:
        if m.state == "uncovered" and m.obligation not in left_out and not covered_by(m.obligation, shown):
            findings.append(f"no test for {m.obligation.text}")
    never = [m for m in measured.measured if m.state == "impossible"]
    findings += _shown_all_the_same(seed, plan, never)
    return counts, [f"seed {seed}: {finding}" for finding in findings]


def _with_true_contracts(program: Program) -> Program:
    """Return a program of which a run can break assumptions alone: others make no test if they are broken."""
    required = (
        replace(c, expression=implies(left, TRUE))
        for c in without_assumed(program).contracts
        if (left := premise(c.expression)) is not None
    )
    return replace(program, contracts=(*assumptions(program), *required))


def _shown_all_the_same(seed: int, plan: CoveragePlan, never: Sequence[Measured]) -> Iterator[str]:
    """Yield the goals that a drawn run shows, though that is proved impossible while assumptions hold."""
    for number in range(_TRACES):
        interpreter = Interpreter(plan.watching)
        for frame in draw_trace(Choices(Random(f"{seed}/{number}")), plan.program, _FRAMES):
            interpreter.step(frame)
            for m in never:
                holds = interpreter.value_of(plan.holds(m.assuming))
                shown = [g.text for g in m.unseen if interpreter.value_of(g.condition) is True]
                if holds and shown:
                    yield f"trace {number} shows {shown}, which is proved impossible"


def _not_late(seed: int, program: Program, result: ProvedInTime) -> list[str]:
    """Return what is wrong with the run that breaks a contract while clients are late."""
    if result.trace is None:
        return []
    name, snapshots = result.contract.name, result.trace.snapshots
    in_time = tuple(s._replace(given={}, lost=frozenset()) for s in snapshots)
    if Replay(program, name).breach(snapshots) is None:
        return [f"seed {seed}: the run with late clients that breaks {name} does not break it"]
    if Replay(program, name).breach(in_time) is not None and not result.in_time.over_reals:
        return [f"seed {seed}: {name} is broken with no client late"]
    return []


def _broken(seed: int, program: Program, proved: Holding) -> Iterator[str]:
    """Yield the contracts that long runs or drawn traces break though they are proved."""
    long_runs = LongRuns(program)
    for name in sorted(proved.always):
        breaking = long_runs.breaking(name)
        if breaking is not None:
            yield f"seed {seed}: a run of {len(breaking)} frames breaks {name}, which is proved"
    for number in range(_TRACES if proved.always else 0):
        choices = Choices(Random(f"{seed}/{number}"))
        trace = draw_trace(choices, program, _FRAMES)
        interpreter = Interpreter(program)
        runs: list[tuple[str, set[str], Iterable[Outcome]]] = [
            ("", proved.always, (interpreter.step(frame) for frame in trace))
        ]
        for kind, holding in (("late", proved.late), ("operators", proved.operators)):
            if holding:
                run = disturbed_run(choices, program, trace, operators=kind == "operators")
                runs.append((f" ({kind})", holding, (frame.outcome for frame in run)))
        late_run = disturbed_run(choices, _in_time(program), trace, operators=False)
        runs.append((" (in time)", proved.always, (frame.outcome for frame in late_run)))
        for kind, holding, outcomes in runs:
            for outcome in outcomes:
                for name in holding.intersection(outcome.breaches):
                    yield f"seed {seed}: trace {number}{kind} breaks {name}, which is proved"


def run(name: str, check: Check, seeds: range, workers: int) -> bool:
    """Run a check of every seed, print the counts and all findings, and return True if there are none."""
    total, findings = Counts(), list[str]()
    with Pool(workers) as pool:
        for counts, found in pool.imap_unordered(partial(_guarded, check), seeds, chunksize=20):
            total.update(counts)
            findings += found
    shown = ", ".join(f"{count:,} {what}" for what, count in sorted(total.items()))
    print(f"{name}: seeds {seeds.start} to {seeds.stop - 1}: {shown}; {len(findings)} findings", flush=True)
    for finding in findings:
        print(finding)
    return not findings


def _guarded(check: Check, seed: int) -> Findings:
    """Return what a check finds, or, as a finding, the error with which it ends."""
    try:
        return check(seed)
    except Exception as error:  # the other seeds go on
        return Counts(), [f"seed {seed}: {type(error).__name__}: {error}"]


def main() -> int:
    """Run all checks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", type=int, default=20_000, help="programs for the executors")
    parser.add_argument("--contracts", type=int, default=5_000, help="programs for contracts")
    parser.add_argument("--coverage", type=int, default=500, help="programs for coverage")
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    whole = range(given.seed, given.seed + given.programs // 2)
    some = range(given.seed, given.seed + given.contracts)
    checks: Iterator[tuple[str, Check, range]] = iter(
        (
            ("executors, whole programs", executors, whole),
            ("executors, networks", partial(executors, network=True), whole),
            ("executors, sequences", sequences, some),
            ("executors, with functions and inputs", outlined, some),
            ("formulas", formulas, some),
            ("verdicts", verdicts, some),
            ("coverage", coverage, range(given.seed, given.seed + given.coverage)),
            ("executors, tunable params", partial(executors, tunable=True), some),
            ("verdicts, tunable params", partial(verdicts, tunable=True), some),
        )
    )
    results = [run(name, check, seeds, given.workers) for name, check, seeds in checks]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
