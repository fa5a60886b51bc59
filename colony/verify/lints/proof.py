"""Proofs and refutations of claims about every frame of every run, in bounded effort.

A program is encoded once, and each claim when it is first asked. Most claims are broken in the first frame of
some run, or hold in a single frame with arbitrary memory: one solver has the formulas of both for all claims.
Only what it leaves open takes an attempt of its own (`contracts/attempt.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum, auto, unique
from functools import cached_property
from itertools import chain
from random import Random
from typing import NamedTuple

import z3

from colony.ir import expression as ir
from colony.ir.expression import Expression, IsIdle
from colony.ir.frame import Outcome
from colony.ir.program import Contract, Module, Program
from colony.ir.types import BOOL
from colony.text.diagnostics import Diagnostic, note
from colony.text.source import Span
from colony.verify.claims import TRUE
from colony.verify.contracts.attempt import Attempt, Proof, ProofContext
from colony.verify.contracts.concrete_runs import GeneratedRuns, Replay
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import RESOURCES_PER_SECOND, ProofOptions, Trace
from colony.verify.contracts.search import CandidateTrace, called_modules
from colony.verify.contracts.solver import Budget, Deadline, SolverAnswer
from colony.verify.contracts.table import table
from colony.verify.reference.interpreter import Interpreter
from colony.verify.snapshot import Snapshot, snapshot_of
from colony.verify.symbolic.encode import OpenEncoding, encode
from colony.verify.symbolic.logic import is_false, is_true
from colony.verify.symbolic.system import ContractFormula, Inexact, Shape
from colony.verify.symbolic.unrolling import OneFrame, reasons_of, snapshots
from colony.verify.testing.frames import Choices, draw_trace, snapshots_of

# --- evidence -----------------------------------------------------------------------------------------
#
# Concrete runs that refute claims: the program's examples, and frames drawn at random.

_RUNS = 12
_FRAMES = 30

_SMALL_PROGRAM = 1000
"""Maximum number of modules and sensors of a program that gets all of the runs; a larger one gets fewer."""

Claims = Mapping[str, Expression]


def with_claims(program: Program, claims: Claims) -> Program:
    """Return the program with claims in place of its contracts; what is unknown breaks no claim."""
    contracts = tuple(
        Contract(name=name, expression=ir.ValueOr(type=BOOL, expression=e, other=TRUE))
        for name, e in claims.items()
    )
    return replace(program, contracts=contracts)


def drawn_breaches(program: Program, runs: GeneratedRuns) -> list[frozenset[str]]:
    """Return the claims that are broken in each frame of the examples of `program` and of drawn traces.

    `runs` are those of the program with claims in place of its contracts.
    """
    traces = chain((snapshots_of(program, t) for t in program.tests), _random_traces(program))
    return [frozenset(outcome.breaches) for trace in traces for outcome in runs.outcomes(trace)]


def has_python_modules(program: Program) -> bool:
    """Return True if a program has modules in Python, whose answers in a run are unknown."""
    return not all(isinstance(m, Module) for m in program.modules)


def _random_traces(program: Program) -> Iterator[tuple[Snapshot, ...]]:
    size = len(program.modules) + len(program.robot.sensors)
    for number in range(max(2, _RUNS * _SMALL_PROGRAM // max(size, _SMALL_PROGRAM))):
        frames = draw_trace(Choices(Random(f"0/{number}")), program, _FRAMES)
        yield tuple(snapshot_of(program, frame) for frame in frames)


def replay(program: Program, snapshots: Iterable[Snapshot]) -> tuple[Outcome, ...]:
    """Return the reference interpreter's outcomes."""
    return tuple(outcome for outcome, _ in frames(program, snapshots))


def frames(program: Program, snapshots: Iterable[Snapshot]) -> Iterator[tuple[Outcome, Interpreter]]:
    """Yield the outcome of each frame, with the reference interpreter as it is after that frame."""
    return Replay(program, "").frames(tuple(snapshots))


# --- proof --------------------------------------------------------------------------------------------

MAX_FRAMES = 8
"""Maximum length of a run: a machine may come through several phases before what is looked for happens."""

OPTIONS = ProofOptions(depth=1, max_frames=MAX_FRAMES, resources=RESOURCES_PER_SECOND // 2)

_ALL_QUESTIONS = 1e9
"""Share of a question's resources for all questions to one solver; `Effort` limits them."""

QUESTION_RESOURCES = RESOURCES_PER_SECOND // 20
"""Resources that a question is charged besides those of z3, for its encoding and the runs that are drawn."""


class Effort(Deadline):
    """A deadline of all questions about a program together.

    `on_question` receives the number of questions asked so far, before each.

    Stateful: `questions_skipped` counts the questions that were left out because the limit was reached.
    """

    def __init__(
        self, resources: int | None = None, on_question: Callable[[int], None] | None = None
    ) -> None:
        super().__init__(resources)
        self._on_question = on_question
        self.questions_asked = 0
        self.questions_skipped = 0

    def allows_question(self) -> bool:
        """Return True if another question may be asked, and charge it; otherwise count it as skipped."""
        if self.is_over():
            self.questions_skipped += 1
            return False
        self.questions_asked += 1
        if self._on_question is not None:
            self._on_question(self.questions_asked)
        self.charge(QUESTION_RESOURCES)
        return True


class Question(NamedTuple):
    """A claim by its name, and a function that returns it, as few claims are ever asked."""

    name: str
    make: Callable[[], Expression]


def asked(name: str, claim: Expression) -> Question:
    """Return the question about a claim that is at hand."""
    return Question(name, lambda: claim)


@unique
class _Quick(Enum):
    """An answer about a claim from single frames."""

    BROKEN = auto()
    HOLDS = auto()
    OPEN = auto()


class LintProver:
    """A prover of claims about one program. Stateful: encodes it on first use, remembers answers.

    `activity` gives, by module, the frames of drawn runs in which it is active, as a set of bits. `shapes`
    are those found for programs with the same memory; what is found is added. `options` limit each question.
    """

    def __init__(
        self,
        program: Program,
        effort: Effort,
        activity: Mapping[str, int],
        shapes: dict[str, Shape],
        options: ProofOptions = OPTIONS,
    ) -> None:
        self._options = options
        self._activity = activity
        self._shapes = shapes
        self._program = program
        self.effort = effort
        self._contexts: dict[str, ProofContext] = {}
        self._contracts: dict[str, Contract] = {}
        self._quick_answers: dict[str, tuple[_Quick, z3.ModelRef | None]] = {}
        self._answers: dict[str, bool] = {}
        self._undecided: set[str] = set()

    @cached_property
    def _encoding(self) -> OpenEncoding:
        encoding = OpenEncoding(self._program, self._shapes)
        self._shapes |= encoding.system.shapes
        return encoding

    @cached_property
    def _shared(self) -> ProofContext:
        return ProofContext(self._encoding.system)

    @property
    def claims_encoded(self) -> int:
        """Number of claims encoded so far."""
        return len(self._contexts)

    def proved(self, questions: Iterable[Question]) -> frozenset[str]:
        """Return the claims that are proved for floats, rounding included."""
        return frozenset(
            q.name for q in questions if self.proved_over_reals(q) and not self._depends_on_rounding(q.name)
        )

    def proved_over_reals(self, question: Question) -> bool:
        """Return True if a claim is proved over the reals, that is, without rounding."""
        name = question.name
        if name not in self._answers:
            if self.effort.is_over():
                self.effort.questions_skipped += 1
                return False
            context = self._context(question)
            claim = context.claims[name]
            if is_true(claim.holds) or is_false(claim.holds):
                self._answers[name] = is_true(claim.holds)
            elif self.effort.allows_question():
                self._answers[name] = self._is_proved(name, context)
        return self._answers.get(name, False)

    def _is_proved(self, name: str, context: ProofContext) -> bool:
        quick, _ = self._quick_answer(name, context)
        if quick is not _Quick.OPEN:
            return quick is _Quick.HOLDS
        return isinstance(Attempt(context, name, Budget(self._options, self.effort)).run(), Proof)

    def constant(self, question: Question) -> bool | None:
        """Return the truth of a claim if its formula is a constant, None otherwise."""
        holds = self._context(question).claims[question.name].holds
        return True if is_true(holds) else False if is_false(holds) else None

    def were_active(self, a: str, b: str) -> bool:
        """Return True if two modules were active in the same frame of a drawn run."""
        return bool(self._activity.get(a, 0) & self._activity.get(b, 0))

    def knows(self, name: str) -> bool:
        """Return True if it is known whether a claim is proved over the reals."""
        return name in self._answers

    def _quick_answer(self, name: str, context: ProofContext) -> tuple[_Quick, z3.ModelRef | None]:
        if context is not self._shared:
            return _Quick.OPEN, None
        if name not in self._quick_answers:
            self._quick_answers[name] = self._ask(context.claims[name])
        return self._quick_answers[name]

    def _ask(self, claim: ContractFormula) -> tuple[_Quick, z3.ModelRef | None]:
        """Return the answer about a claim, with a model of a first frame that breaks it."""
        if is_true(claim.holds):
            return _Quick.HOLDS, None
        frames, budget = self._shared.single_frames, Budget(self._options, self.effort, _ALL_QUESTIONS)
        answer, model = frames.breaks_first(claim, budget)
        if answer is SolverAnswer.SAT:
            return _Quick.BROKEN, model
        if answer is SolverAnswer.UNSAT and frames.breaks(claim, (), budget)[0] is SolverAnswer.UNSAT:
            return _Quick.HOLDS, None
        return _Quick.OPEN, None

    def _context(self, question: Question) -> ProofContext:
        """Return the context that has a claim, which is encoded when first asked."""
        if question.name not in self._contexts:
            expression = ir.ValueOr(type=BOOL, expression=question.make(), other=TRUE)
            contract = Contract(name=question.name, expression=expression)
            if any(isinstance(x, ir.MemoryCall) for x in ir.subexpressions(expression)):
                program = replace(self._program, contracts=(contract,))
                context = ProofContext(encode(program, known=self._encoding.system.shapes))
            else:
                context = self._shared
                context.add(self._encoding.claim(contract))
            self._contexts[question.name] = context
            self._contracts[question.name] = contract
        return self._contexts[question.name]

    def _depends_on_rounding(self, name: str) -> bool:
        context = self._contexts[name]
        reasons = reasons_of(context.system, context.claims[name].holds)
        return any(r.kind is Inexact.ROUNDING for r in reasons)

    def broken_start(self, name: str) -> Snapshot | None:
        """Return the first frame of a run that breaks a claim in a model, None if there is no such model."""
        _, model = self._quick_answers.get(name, (None, None))
        if model is None:
            return None
        [snapshot] = snapshots(model, OneFrame(self._shared.system, self._shared.cones[name]), 1)
        return snapshot

    def refuted(self, question: Question) -> Trace | None:
        """Return a run of the reference interpreter that breaks a claim, if one is found.

        Modules in Python answer in it as suits the run.
        """
        return next(self.refutations(question), None)

    def refutations(self, question: Question) -> Iterator[Trace]:
        """Yield runs of the reference interpreter that break a claim: of one frame, and of an attempt."""
        name = question.name
        if not self.effort.allows_question():
            return
        context = self._context(question)
        called = called_modules(context.cones[name])
        quick, model = (_Quick.OPEN, None) if called else self._quick_answer(name, context)
        if quick is _Quick.HOLDS:
            self._answers[name] = True
            return
        program = replace(self._program, contracts=(self._contracts[name],))
        refuter = Refuter(program, name, called, deadline=self.effort)
        first = None
        if model is not None:
            frame = OneFrame(context.system, context.cones[name])
            first = refuter.confirm_in(frame, CandidateTrace(model, 1, without_python=True))
        if first is not None:
            yield first
        budget = Budget(self._options, self.effort)
        attempt = Attempt(context, name, budget, refuter, asks_first_frame=False)
        found = attempt.run()
        if isinstance(found, Proof):
            self._answers[name] = True
            return
        trace = found or attempt.python_trace or refuter.search_runs()
        if trace is not None:
            yield trace
        elif first is None:
            self._undecided.add(name)

    def is_undecided(self, name: str) -> bool:
        """Return True if a claim was asked to be refuted, and was neither refuted nor proved."""
        return name in self._undecided


# --- finding ------------------------------------------------------------------------------------------
#
# The result of a lint.


@dataclass(frozen=True, slots=True)
class FindingRun:
    """A run of the reference interpreter that shows a finding about `subject`, by the commands of `actuator`.

    Without an actuator it shows those of all.
    """

    subject: str
    actuator: str | None
    trace: Trace


@dataclass(frozen=True, slots=True)
class Finding:
    """A diagnostic of a lint, with the run that shows it if the message alone cannot."""

    diagnostic: Diagnostic
    run: FindingRun | None = None


def undecided(span: Span, what: str, hint: str) -> Diagnostic:
    """Return the note that neither a run nor a proof decides whether `what` happens."""
    because = f"no run of up to {MAX_FRAMES} frames shows it, and no proof rules it out"
    return note("V035", span, f"whether {what} is unknown: {because}", hint)


# --- report -------------------------------------------------------------------------------------------
#
# Findings of lints as lines of text.


def run_lines(program: Program, finding: Finding) -> tuple[str, ...]:
    """Return the code and the subject on one line, and the run that shows them indented below it, if any."""
    run = finding.run
    if run is None:
        return ()
    shown = TRUE if run.actuator is None else IsIdle(type=BOOL, actuator=run.actuator)
    about = Contract(name=run.subject, expression=shown)
    rows = table(program, about, run.trace)
    return (f"{finding.diagnostic.code:8} {run.subject}", *(f"  {row}" for row in rows))
