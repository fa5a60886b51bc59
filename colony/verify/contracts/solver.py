"""z3 with limits: every query ends, and in the same way on every machine, however busy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import Enum, auto, unique

import z3

from colony.verify.contracts.results import ProofOptions


@unique
class SolverAnswer(Enum):
    """The answer of z3: there is a model, there is none, or it gave up."""

    SAT = auto()
    UNSAT = auto()
    GAVE_UP = auto()


_QUERIES = 8
"""Number of full-cost queries that the budget of a contract covers."""

_MAX_LIMIT = 2**32 - 1
"""The largest limit of a query that z3 takes."""


class Deadline:
    """A limit on all work together, of z3 and in Python, in z3's resource units; None for no limit. Stateful.

    Work in Python is charged by what it does, not by a clock: the same work costs the same on every machine.
    `on_stage` receives what is being done.
    """

    def __init__(self, resources: int | None = None, on_stage: Callable[[str], None] | None = None) -> None:
        self._on_stage = on_stage
        self._part = ""
        self._left = math.inf if resources is None else resources
        self._kept = 0.0
        self.spent = 0

    def begin_stage(self, text: str) -> None:
        """Report what is being done, after the name of the part."""
        if self._on_stage is not None:
            self._on_stage(f"{self._part}: {text}")

    @property
    def left(self) -> float:
        """Resources left of the present part."""
        return self._left - self._kept

    def begin_part(self, parts: int, name: str = "") -> None:
        """Begin the first of so many parts: keep an equal share of what is left for each of the others."""
        self._part = name
        self._kept = 0.0 if math.isinf(self._left) else max(0.0, self._left * (1 - 1 / parts))

    def charge(self, resources: int) -> None:
        """Subtract the cost of work."""
        self._left -= resources
        self.spent += resources

    def charge_all(self, resources: int) -> None:
        """Subtract the cost of work for all parts from each, in proportion to what it has."""
        before = self._left
        self.charge(resources)
        if before > 0 and math.isfinite(before):
            self._kept *= max(0.0, self._left) / before

    def is_over(self) -> bool:
        """Return True if the present part has nothing left."""
        return self.left <= 0


class Budget:
    """The budget of one contract. Stateful: tracks the resources left, and whether z3 gave up.

    `deadline` limits several budgets together.
    """

    def __init__(self, options: ProofOptions, deadline: Deadline | None = None, share: float = 1.0) -> None:
        self.options = options
        self.deadline = Deadline() if deadline is None else deadline
        self._resources = int(options.resources * share)
        self.gave_up = False

    def scaled(self, share: float = 0.5) -> Budget:
        """Return a budget with a share of the initial resources."""
        return Budget(self.options, self.deadline, share)

    @property
    def left(self) -> int:
        """Resources left, in z3's units; negative if the last query took more."""
        return self._resources

    def part(self, share: float) -> int:
        """Return the limit of a query that may use a share of the initial resources, within those left."""
        return self.limited(min(max(1, int(self.options.resources * share)), max(1, self._resources)))

    def limited(self, resources: int) -> int:
        """Return the limit of a query that may use these resources, within those left before the deadline."""
        return int(max(1, min(resources, self.deadline.left, _MAX_LIMIT)))

    def charge(self, resources: int) -> None:
        """Subtract the cost of a query, in z3's units."""
        self._resources -= resources
        self.deadline.charge(resources)

    def charge_since(self, spent: int) -> None:
        """Subtract what the deadline was charged since it had `spent` so much."""
        self._resources -= self.deadline.spent - spent

    def is_spent(self) -> bool:
        """Return True if the budget is used up."""
        over = self._resources <= 0 or self.deadline.is_over()
        self.gave_up = self.gave_up or over
        return over


class IncrementalSolver:
    """An incremental z3 solver within a budget, which must be set before a query. Mutable."""

    def __init__(self, budget: Budget | None = None, share: float = 1.0) -> None:
        """Create a solver; each query may use `share` of a full query's resources."""
        self._z3 = z3.Solver()
        self._z3.push()  # makes z3 incremental, which is faster for such queries
        if budget is not None:
            self.use(budget, share)

    def use(self, budget: Budget, share: float = 1.0) -> None:
        """Charge each further query to a budget, and limit it to a share of a full query's resources."""
        self._budget = budget
        self._full_limit = max(1, int(budget.options.resources * share / _QUERIES))

    def add(self, *formulas: z3.BoolRef) -> None:
        """Add formulas to the current level."""
        self._z3.add(*formulas)

    def push(self) -> None:
        """Open a level of formulas."""
        self._z3.push()

    def pop(self) -> None:
        """Drop the formulas of the current level."""
        self._z3.pop()

    def check(self, assumed: Sequence[z3.BoolRef] = ()) -> SolverAnswer:
        """Ask z3 for a model of all formulas that were added or are `assumed`.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed while z3 was at work.
        """
        if self._budget.is_spent():
            return SolverAnswer.GAVE_UP
        self._query_limit = self._budget.limited(self._full_limit)
        self._z3.set("rlimit", self._query_limit)
        before = _resources_used(self._z3)
        result = self._z3.check(*assumed)
        used = _resources_used(self._z3) - before
        self._budget.charge(used)
        if result == z3.sat:
            return SolverAnswer.SAT
        if result == z3.unsat:
            return SolverAnswer.UNSAT
        if self._interrupted(used):
            raise KeyboardInterrupt
        self._budget.gave_up = True
        return SolverAnswer.GAVE_UP

    def _interrupted(self, used: int) -> bool:
        """Return True if a query was ended by Ctrl-C, not by its difficulty or a limit.

        z3 reports Ctrl-C in the same words as a limit.
        """
        reason = self._z3.reason_unknown()
        return "interrupted" in reason or ("canceled" in reason and used < self._query_limit)

    def model(self) -> z3.ModelRef:
        """Return the model of the last answer, which was SAT."""
        return self._z3.model()

    def core(self) -> frozenset[str]:
        """Return the names of the assumed constants that the last answer, UNSAT, depends on."""
        return frozenset(str(c) for c in self._z3.unsat_core())


def _resources_used(solver: z3.Solver) -> int:
    """Return the resources that all solvers of z3 have used so far."""
    statistics = solver.statistics()
    return int(statistics.get_key_value("rlimit count")) if "rlimit count" in list(statistics.keys()) else 0
