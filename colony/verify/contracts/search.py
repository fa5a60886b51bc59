"""Bounded model checking (Biere et al., 1999): the shortest traces that break a contract.

At each length it tries frames one period apart before frames at arbitrary times, as they are more realistic,
and traces without Python calls before those with arbitrary answers of Python modules, as only the
former refute the contract.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from typing import NamedTuple, cast

import z3

from colony.verify.contracts.slicing import facts, within
from colony.verify.contracts.solver import Budget, IncrementalSolver, SolverAnswer
from colony.verify.symbolic.logic import real
from colony.verify.symbolic.system import ContractFormula, ExtendedReal, System
from colony.verify.symbolic.unrolling import Cone, Unrolling

_REGULAR = z3.Bool("frames a period apart")
_WITHOUT_PYTHON = z3.Bool("no module in Python is asked")


class CandidateTrace(NamedTuple):
    """A model that breaks the contract in its last frame.

    `frames` is its length. With `without_python` it breaks the contract whatever Python modules would answer.
    """

    model: z3.ModelRef
    frames: int
    without_python: bool


class Search:
    """A search for traces of growing length that break one contract. Stateful: remembers the length so far.

    `safe_length` is the number of frames from the start that provably do not break it, whatever the readings.
    `last_cost` is the cost of the last length that was searched, in z3's resource units.
    """

    def __init__(
        self, cone: Cone, claim: ContractFormula, budget: Budget, lemmas: Sequence[z3.BoolRef] = ()
    ) -> None:
        self.frames = Unrolling(cone.system, cone)
        self.safe_length = 0
        self.last_cost = 0
        self._length = 0
        self._all_safe = True
        self._facts = facts(cone)
        self._claim = claim
        self._lemmas = lemmas
        self._budget = budget
        self._solver = IncrementalSolver(budget)
        self._solver.add(*self.frames.initial())
        self._python = [cone.system.modules[m].silent for m in called_modules(cone)]

    @property
    def length(self) -> int:
        """Number of frames searched."""
        return self._length

    def skip_to(self, length: int) -> None:
        """Extend the trace to `length` frames without a search at the lengths between."""
        while self._length < length:
            self._extend(self._length)
            self._length += 1
            self._all_safe = False

    def search_next_length(self, allow_python: bool = True) -> Iterator[CandidateTrace]:
        """Search traces that are one frame longer; yield distinct models.

        Without `allow_python`, only those in which no Python module is called.
        """
        last, left = self._length, self._budget.left
        self._extend(last)
        self._length += 1
        broken = z3.Not(self.frames.at(last, self._claim.holds))
        self._solver.push()
        try:
            self._solver.add(broken)
            for assumed in self._modes(last, allow_python):
                yield from self._models(assumed, last)
        finally:
            self._solver.pop()
            self.last_cost = left - self._budget.left
        if self._all_safe and (allow_python or not self._python):
            self.safe_length = self._length
            self._solver.add(z3.Not(broken))

    def _models(self, assumed: list[z3.BoolRef], last: int) -> Iterator[CandidateTrace]:
        while True:
            answer = self._solver.check(assumed)
            if answer is SolverAnswer.UNSAT:
                return
            self._all_safe = False
            if answer is SolverAnswer.GAVE_UP:
                return
            model = self._solver.model()
            yield CandidateTrace(model, last + 1, not self._python or _WITHOUT_PYTHON in assumed)
            self._solver.add(self._inputs_differ(model, last))

    def _modes(self, last: int, allow_python: bool) -> Iterator[list[z3.BoolRef]]:
        """Yield the assumptions to try in turn; the last mode allows the most."""
        without = [[_WITHOUT_PYTHON]] if self._python else []
        for mode in (*without, *([[]] if allow_python or not self._python else [])):
            if last > 0:
                yield [_REGULAR, *mode]
            yield mode

    def _extend(self, frame: int) -> None:
        """Add a frame to the trace."""
        system = self.frames.cone.system
        if frame > 0:
            self._solver.add(*self.frames.transition(frame - 1))
            before, now = self.frames.at(frame - 1, system.now), self.frames.at(frame, system.now)
            self._solver.add(z3.Implies(_REGULAR, now == before + system.program.robot.frame_ns))
        self._solver.add(self.frames.at(frame, self._facts))
        for silent in self._python:
            self._solver.add(z3.Implies(_WITHOUT_PYTHON, self.frames.at(frame, silent)))
        self._solver.add(*(self.frames.at(frame, lemma) for lemma in self._lemmas))

    def _inputs_differ(self, model: z3.ModelRef, frame: int) -> z3.BoolRef:
        """Return the condition that an input of the last frame is far from its value in `model`.

        A spurious model is often at the very edge of a comparison, where its neighbors are spurious, too.
        """
        system = self.frames.cone.system
        differences = []
        for sensor_input in system.sensors.values():
            for scalar in sensor_input.elements:
                differences += _differs(scalar, model, self.frames, frame)
            if within(self.frames.cone, sensor_input.present):
                present = self.frames.at(frame, sensor_input.present)
                differences.append(present != model.eval(present, model_completion=True))
        return z3.Or(*differences) if differences else z3.BoolVal(False)


def called_modules(cone: Cone) -> tuple[str, ...]:
    """Return the modules in Python whose answers make a difference to a cone."""
    return tuple(m for m, inputs in cone.system.python.items() if within(cone, inputs.answers))


def _differs(
    scalar: ExtendedReal | z3.BoolRef, model: z3.ModelRef, frames: Unrolling, frame: int
) -> list[z3.BoolRef]:
    """Return the condition that a value is more than a hundredth off a model's; none outside the cone."""
    term = scalar.value if isinstance(scalar, ExtendedReal) else scalar
    if not within(frames.cone, term):
        return []
    constant = frames.at(frame, term)
    value = model.eval(constant, model_completion=True)
    if not z3.is_arith(value):
        return [constant != value]
    if not isinstance(value, z3.RatNumRef):
        margin = z3.If(value < 0, -value, value) / 100 + z3.Q(1, 1000)
        return [z3.Or(constant > value + margin, constant < value - margin)]
    exact = value.as_fraction()
    off = abs(exact) / 100 + Fraction(1, 1000)
    return [cast(z3.BoolRef, constant > real(exact + off)), cast(z3.BoolRef, constant < real(exact - off))]


# --- single frames ------------------------------------------------------------------------------------
#
# Proofs and counterexamples in a single frame: any frame with any memory, or the first frame of a run.
#
# One solver has the formulas of all claims about a system, and keeps what it learned of the system.


class KnownCondition(NamedTuple):
    """A condition that is true in every frame, and its description."""

    text: str
    formula: z3.BoolRef


class SingleFrames:
    """A frame of a system, in one solver. Mutable: facts are added when a claim first needs them."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._cells = {c.old.get_id(): c for c in system.cells}
        self._solver = IncrementalSolver()
        self._is_first = z3.Bool("first frame of a run")
        self._added = set[int]()
        self._add([system.now, system.begun, system.last])

    def breaks_first(self, claim: ContractFormula, budget: Budget) -> tuple[SolverAnswer, z3.ModelRef | None]:
        """Return whether the first frame of a run may break a claim, with a model if it may."""
        with self._broken(claim, budget, 1.0):
            answer = self._solver.check([self._is_first])
            return answer, self._solver.model() if answer is SolverAnswer.SAT else None

    def breaks(
        self, claim: ContractFormula, known: Sequence[KnownCondition], budget: Budget, share: float = 1.0
    ) -> tuple[SolverAnswer, tuple[str, ...]]:
        """Return whether a frame may break a claim; if none may, with those of `known` that show it."""
        switches = [z3.Bool(f"known {i}") for i in range(len(known))]
        self._add(k.formula for k in known)
        with self._broken(claim, budget, share):
            self._solver.add(*(z3.Implies(s, k.formula) for s, k in zip(switches, known, strict=True)))
            answer = self._solver.check(switches)
            core = self._solver.core() if answer is SolverAnswer.UNSAT else frozenset()
        return answer, tuple(k.text for k, s in zip(known, switches, strict=True) if str(s) in core)

    @contextmanager
    def _broken(self, claim: ContractFormula, budget: Budget, share: float) -> Iterator[None]:
        """Assume that a claim is broken."""
        self._add([claim.holds])
        self._solver.use(budget, share)
        self._solver.push()
        try:
            self._solver.add(z3.Not(claim.holds))
            yield
        finally:
            self._solver.pop()

    def _add(self, terms: Iterable[z3.ExprRef]) -> None:
        """Add the facts on which terms depend within a frame."""
        graph = self._system.graph
        pending = graph.add(terms)
        while pending:
            key = pending.pop()
            if key in self._added:
                continue
            self._added.add(key)
            pending.extend(graph.operands(key))
            if key in self._cells:
                cell = self._cells[key]
                self._solver.add(z3.Implies(self._is_first, cell.old == cell.initial))
            formulas = [fact.formula for fact in self._system.facts.get(key, ())]
            self._solver.add(*formulas)
            pending.extend(graph.add(formulas))


# --- induction ----------------------------------------------------------------------------------------
#
# k-induction (Sheeran, Singh and Stalmarck, 2000): what holds in k consecutive frames holds in the next.
#
# The memory before the first of these frames is arbitrary, within the invariants.


class ContractInduction:
    """The inductive step for a contract, for k = 1, 2, ... Stateful: each k adds a frame.

    `known` are conditions that hold in every frame: invariants, and contracts proved earlier.
    """

    def __init__(
        self, cone: Cone, claim: ContractFormula, known: Sequence[KnownCondition], budget: Budget
    ) -> None:
        self._frames = Unrolling(cone.system, cone)
        self._facts = facts(cone)
        self._claim = claim
        self._known = known
        self._switches = _switches(known)
        self._solver = IncrementalSolver(budget)
        self._last = 0
        self._extend()

    def prove_next_k(self) -> tuple[str, ...] | None:
        """Return the conditions of `known` that prove the step for the next k, None if it is not proved."""
        self._solver.add(self._frames.at(self._last, self._claim.holds))
        self._solver.add(*self._frames.transition(self._last))
        self._last += 1
        self._extend()
        goal = z3.Bool(f"broken {self._last}")
        broken = z3.Not(self._frames.at(self._last, self._claim.holds))
        self._solver.add(z3.Implies(goal, broken))
        if self._solver.check([goal, *self._switches]) is not SolverAnswer.UNSAT:
            return None
        return _used(self._solver, self._known, self._switches)

    def _extend(self) -> None:
        """Assume the facts and known conditions of the last frame."""
        self._solver.add(self._frames.at(self._last, self._facts))
        for switch, condition in zip(self._switches, self._known, strict=True):
            self._solver.add(z3.Implies(switch, self._frames.at(self._last, condition.formula)))


def _switches(known: Sequence[KnownCondition]) -> list[z3.BoolRef]:
    """Return a constant for each known condition; assuming the constant assumes the condition."""
    return [z3.Bool(f"known {i}") for i in range(len(known))]


def _used(
    solver: IncrementalSolver, known: Sequence[KnownCondition], switches: Sequence[z3.BoolRef]
) -> tuple[str, ...]:
    core = solver.core()
    return tuple(k.text for k, s in zip(known, switches, strict=True) if str(s) in core)
