"""Tests of one program over many traces: agreement of executors, coverage of modules, contracts.

    for report in try_traces(program, count=1000, seed=1):
        print(report.drawn)
    report.disagreement, report.breaches, report.modules

Traces are determined by a seed. Each is guided by the patterns that earlier traces and the program's own
tests reached (`guided.py`), so that rare situations are tested, too. A trace that shows a fault is shrunk.

Modules in Python are run; every executor has its own instances. The answers of such a module must depend only
on its params and on its inputs since it was built: no clock, no randomness, no file that changes. Otherwise
no two executors could agree. So two reference interpreters are compared first, and a module that answers
differently in them is reported.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from random import Random
from types import MappingProxyType
from typing import NamedTuple, Protocol, runtime_checkable

from colony.compile.pipeline import Compilation, compile_program
from colony.ir.expression import StateValue
from colony.ir.frame import Executor, Frame, Outcome
from colony.ir.program import Contract, Machine, Program, PythonModule
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import ALL_EXECUTORS, Disagreement, Factory, disagreement
from colony.verify.testing.frames import Choices, frames_of
from colony.verify.testing.guided import MAX_PREFIX_FRAMES, Guide
from colony.verify.testing.shrinking import shrink_trace

FRAMES = 12
"""Maximum number of frames of a new trace."""

Trial = Callable[[Compilation, Sequence[Frame], int], Disagreement | None]
"""A check of a trace, with a seed for its own random draws, such as faults."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleCoverage:
    """Numbers of frames in which a module won, was active, and was silent because a reading was missing.

    `won` is None for a module that commands nothing.
    """

    name: str
    won: int | None
    active: int
    silent: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Breach:
    """A contract that is broken in the last frame of `trace`; `frames` counts the frames that broke it."""

    contract: Contract
    trace: tuple[Frame, ...]
    frames: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Nondeterministic:
    """A Python module whose two instances answered the last frame of a trace differently."""

    module: PythonModule
    trace: tuple[Frame, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DifferentialReport:
    """The findings after `drawn` of `asked` traces, with `frames` frames in total.

    `finished` is true if no report follows: all traces are drawn, or there is a disagreement, or a module
    that is not deterministic.
    """

    seed: int
    asked: int
    drawn: int
    frames: int
    modules: tuple[ModuleCoverage, ...]
    breaches: tuple[Breach, ...] = ()
    disagreement: Disagreement | None = None
    nondeterministic: Nondeterministic | None = None
    finished: bool = False

    @property
    def never_won(self) -> tuple[str, ...]:
        """Modules that command an actuator but won in no trace."""
        return tuple(m.name for m in self.modules if m.won == 0)


def try_traces(
    program: Program,
    count: int,
    seed: int,
    *,
    executors: Mapping[str, Factory] = ALL_EXECUTORS,
    trials: Mapping[str, Trial] = MappingProxyType({}),
    max_frames: int = FRAMES,
) -> Iterator[DifferentialReport]:
    """Draw `count` traces of `program`, and yield a report after each. The last one is `finished`.

    The reports are the same for the same program, count and seed. A finding is reported as it was drawn, and
    again once it is shrunk. `executors` are compared with the reference interpreter, and `trials` are run in
    addition. A disagreement ends the test; a broken contract does not.

    Raises:
        DiagnosticError: a module in Python cannot be imported or built.
    """
    test = _TraceTest(program, count, seed, executors, trials, max_frames)
    while not test.report.finished:
        test.advance()
        yield test.report


# --- the test in progress ------------------------------------------------------------------------


@runtime_checkable
class _Restartable(Executor, Protocol):
    """An executor that can be restarted, which is faster than making a new one."""

    def restart(self) -> None: ...


class _Run(NamedTuple):
    """The reference's run over a trace: the outcome, active and silent modules, and pattern of each frame."""

    outcomes: tuple[Outcome, ...]
    active: tuple[tuple[str, ...], ...]
    silent: tuple[tuple[str, ...], ...]
    patterns: tuple[Hashable, ...]


class _TraceTest:
    """A test of one program over many traces. Stateful: holds the report, and executors to be reused."""

    def __init__(
        self,
        program: Program,
        count: int,
        seed: int,
        executors: Mapping[str, Factory],
        trials: Mapping[str, Trial],
        max_frames: int,
    ) -> None:
        self._program, self._executors, self._trials = program, executors, trials
        self._compilation = compile_program(program)
        self._executors_in_use: dict[str, Executor] = {}
        self._guide = Guide(program, max_frames)
        self._machines = [
            StateValue(type=d.type, name=d.name) for d in program.derived if isinstance(d, Machine)
        ]
        for example in program.tests:  # situations that an author considered worth a test
            test_frames = frames_of(program, example)[:MAX_PREFIX_FRAMES]
            self._guide.learn(test_frames, self._reference(test_frames).patterns)
        self._python = [m for m in program.modules if isinstance(m, PythonModule)]
        self._to_shrink: list[Callable[[], None]] = []
        self._counts: Counter[tuple[str, str]] = Counter()
        self.report = DifferentialReport(seed=seed, asked=count, drawn=0, frames=0, modules=self._modules())

    def advance(self) -> None:
        """Test another trace, or shrink a finding from the last one."""
        if self._to_shrink:
            self._to_shrink.pop(0)()
        elif self.report.disagreement is None and self.report.drawn < self.report.asked:
            self._next_trace()
        if not self._to_shrink:
            report = self.report
            stopped = report.disagreement is not None or report.nondeterministic is not None
            self._update(finished=stopped or report.drawn >= report.asked)

    def _next_trace(self) -> None:
        number = self.report.drawn
        trace = self._guide.draw(Choices(Random(f"{self.report.seed}/{number}")))
        run = self._reference(trace)
        self._update(drawn=number + 1, frames=self.report.frames + len(trace))
        nondeterministic = self._nondeterministic(trace, run)
        if nondeterministic is not None:
            self._update(nondeterministic=nondeterministic)
            return
        self._guide.learn(trace, run.patterns)
        self._count(run)
        for name in dict.fromkeys(name for outcome in run.outcomes for name in outcome.breaches):
            self._breach(name, trace, run)
        if not self._difference(trace, run.outcomes):
            self._run_trials(trace, number)

    def _update(self, **changes: object) -> None:
        self.report = replace(self.report, **changes)  # type: ignore[arg-type]

    # --- the reference ---------------------------------------------------------------------------

    def _reference(self, trace: Sequence[Frame]) -> _Run:
        interpreter = Interpreter(self._program)
        outcomes, active, silent, patterns = [], [], [], []
        names = [m.name for m in self._program.modules]
        for frame in trace:
            outcome = interpreter.step(frame)
            outcomes.append(outcome)
            active.append(tuple(n for n in names if interpreter.is_active(n)))
            silent.append(tuple(n for n in names if interpreter.is_silent(n)))
            phases = tuple(interpreter.value_of(machine) for machine in self._machines)
            faults = tuple((d.by, d.fault) for d in outcome.decisions)
            patterns.append((active[-1], faults, phases, outcome.breaches))
        return _Run(tuple(outcomes), tuple(active), tuple(silent), tuple(patterns))

    def _nondeterministic(self, trace: Sequence[Frame], run: _Run) -> Nondeterministic | None:
        """Return the first module in Python in which two interpreters differ."""
        if not self._python:
            return None
        again = self._reference(trace)
        for i, (first, second) in enumerate(zip(run.outcomes, again.outcomes, strict=True)):
            if repr(first) != repr(second) or run.active[i] != again.active[i]:
                module = self._suspect(run, again, i)
                return Nondeterministic(module=module, trace=tuple(trace[: i + 1]))
        return None

    def _suspect(self, first: _Run, second: _Run, i: int) -> PythonModule:
        """Return the module whose activity, command or exception differs between two runs."""
        for module in self._python:
            answers = [
                (
                    module.name in run.active[i],
                    repr([d for d in run.outcomes[i].decisions if d.by == module.name]),
                    [r for r in run.outcomes[i].records if r.subject == module.name],
                )
                for run in (first, second)
            ]
            if answers[0] != answers[1]:
                return module
        return self._python[0]

    # --- coverage and contracts ------------------------------------------------------------------

    def _count(self, run: _Run) -> None:
        for outcome, active, silent in zip(run.outcomes, run.active, run.silent, strict=True):
            self._counts.update((name, "won") for name in {d.by for d in outcome.decisions if d.by})
            self._counts.update((name, "active") for name in active)
            self._counts.update((name, "silent") for name in silent)
        self._update(modules=self._modules())

    def _modules(self) -> tuple[ModuleCoverage, ...]:
        commanding = {m.name: m.actuator is not None for m in self._program.modules}
        return tuple(
            ModuleCoverage(
                name=name,
                won=self._counts[name, "won"] if commands else None,
                active=self._counts[name, "active"],
                silent=self._counts[name, "silent"],
            )
            for name, commands in commanding.items()
        )

    def _breach(self, name: str, trace: tuple[Frame, ...], run: _Run) -> None:
        """Count how often a contract is broken; the first trace that shows it is shrunk later."""
        breached = [i for i, outcome in enumerate(run.outcomes) if name in outcome.breaches]
        known = {b.contract.name: b for b in self.report.breaches}
        if name in known:
            self._put_breach(replace(known[name], frames=known[name].frames + len(breached)))
            return
        contract = next(c for c in self._program.contracts if c.name == name)
        self._put_breach(Breach(contract=contract, trace=trace[: breached[0] + 1], frames=len(breached)))

        def broken(frames: tuple[Frame, ...]) -> int | None:
            interpreter = Interpreter(self._program)
            return next((i for i, f in enumerate(frames) if name in interpreter.step(f).breaches), None)

        def shrink() -> None:
            found = next(b for b in self.report.breaches if b.contract.name == name)
            self._put_breach(replace(found, trace=shrink_trace(self._program, found.trace, broken)))

        self._to_shrink.append(shrink)

    def _put_breach(self, breach: Breach) -> None:
        """Insert or replace a breach, in the order of the program's contracts."""
        known = {b.contract.name: b for b in self.report.breaches} | {breach.contract.name: breach}
        self._update(breaches=tuple(known[c.name] for c in self._program.contracts if c.name in known))

    # --- executors and trials --------------------------------------------------------------------

    def _difference(self, trace: tuple[Frame, ...], expected: Sequence[Outcome]) -> bool:
        """Return True if one of the executors differs from the reference."""
        for name, make in self._executors.items():
            found = disagreement(
                self._program,
                trace,
                {name: partial(self._reused_executor, name)},
                expected,
                self._compilation,
            )
            if not isinstance(self._executors_in_use.get(name), _Restartable):
                self._executors_in_use.pop(name, None)
            if found is not None:
                self._record_disagreement(
                    found, trace, partial(disagreement, self._program, executors={name: make})
                )
                return True
        return False

    def _reused_executor(self, name: str, compilation: Compilation) -> Executor:
        """Return an executor with its initial memory: the previous one, restarted, or a new one."""
        used = self._executors_in_use.get(name)
        if isinstance(used, _Restartable):
            used.restart()
            return used
        executor = self._executors_in_use[name] = self._executors[name](compilation)
        return executor

    def _run_trials(self, trace: tuple[Frame, ...], number: int) -> None:
        for name, trial in self._trials.items():
            seed = self.report.seed * 1_000_003 + number

            def attempt(
                frames: Sequence[Frame], trial: Trial = trial, name: str = name, seed: int = seed
            ) -> Disagreement | None:
                found = trial(self._compilation, frames, seed)
                return None if found is None else replace(found, executor=name)

            found = attempt(trace)
            if found is not None:
                self._record_disagreement(found, trace, attempt)
                return

    def _record_disagreement(
        self,
        found: Disagreement,
        trace: tuple[Frame, ...],
        attempt: Callable[[tuple[Frame, ...]], Disagreement | None],
    ) -> None:
        """Record a disagreement, to be shrunk if it recurs without the earlier traces."""
        self._update(disagreement=found)

        def fails(frames: tuple[Frame, ...]) -> int | None:
            return None if attempt(frames) is None else len(frames) - 1

        def shrink() -> None:
            if fails(trace) is None:
                self._update(disagreement=replace(found, executor=f"{found.executor}, after other traces"))
            else:
                self._update(disagreement=attempt(shrink_trace(self._program, trace, fails)) or found)

        self._to_shrink.append(shrink)
