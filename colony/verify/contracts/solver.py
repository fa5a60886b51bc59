"""z3 with limits: every query ends, and without a clock it ends in the same way on every machine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum, auto, unique

import z3

from colony.verify.contracts.results import Options

Clock = Callable[[], float]
"""A clock in seconds, with any origin."""


@unique
class Answer(Enum):
    """The answer of z3: there is a model, there is none, or it gave up."""

    SAT = auto()
    UNSAT = auto()
    GAVE_UP = auto()


_QUERIES = 8
"""Number of full-cost queries that the budget of a contract covers."""


class Budget:
    """The budget of one contract. Stateful: tracks the resources left, and whether z3 gave up.

    Without a clock, only resources are limited.
    """

    def __init__(self, options: Options, clock: Clock | None = None) -> None:
        self.options = options
        self._clock = clock
        self._deadline = None if clock is None else clock() + options.seconds
        self._resources = options.resources
        self.gave_up = False

    def scaled(self, share: float = 0.5) -> Budget:
        """Return a budget with the same deadline and a share of the initial resources."""
        budget = Budget(self.options, self._clock)
        budget._deadline = self._deadline
        budget._resources = int(budget._resources * share)
        return budget

    @property
    def milliseconds_left(self) -> int | None:
        """Milliseconds until the deadline, at least 0; None without a clock."""
        if self._clock is None or self._deadline is None:
            return None
        return max(0, int((self._deadline - self._clock()) * 1000))

    def charge(self, resources: int) -> None:
        """Subtract the cost of a query, in z3's units."""
        self._resources -= resources

    def is_spent(self) -> bool:
        """Return True if the budget is used up."""
        over = self.milliseconds_left == 0 or self._resources <= 0
        self.gave_up = self.gave_up or over
        return over


_GRACE_MS = 50
"""Milliseconds by which z3 may stop before its time limit."""


class Solver:
    """An incremental z3 solver within a budget. Mutable."""

    def __init__(self, budget: Budget, share: float = 1.0) -> None:
        """Create a solver; each query may use `share` of a full query's resources."""
        self._budget = budget
        self._z3 = z3.Solver()
        self._z3.push()  # makes z3 incremental, which is faster for such queries
        self.limit(share)

    def limit(self, share: float) -> None:
        """Limit each further query to a share of a full query's resources."""
        self._query_limit = max(1, int(self._budget.options.resources * share / _QUERIES))
        self._z3.set("rlimit", self._query_limit)

    def add(self, *formulas: z3.BoolRef) -> None:
        """Add formulas to the current level."""
        self._z3.add(*formulas)

    def push(self) -> None:
        """Open a level of formulas."""
        self._z3.push()

    def pop(self) -> None:
        """Drop the formulas of the current level."""
        self._z3.pop()

    def check(self, assumed: Sequence[z3.BoolRef] = ()) -> Answer:
        """Ask z3 for a model of all formulas that were added or are `assumed`.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed while z3 was at work.
        """
        if self._budget.is_spent():
            return Answer.GAVE_UP
        left = self._budget.milliseconds_left
        if left is not None:
            self._z3.set("timeout", left)
        before = _resources_used(self._z3)
        result = self._z3.check(*assumed)
        used = _resources_used(self._z3) - before
        self._budget.charge(used)
        if result == z3.sat:
            return Answer.SAT
        if result == z3.unsat:
            return Answer.UNSAT
        if self._interrupted(used):
            raise KeyboardInterrupt
        self._budget.gave_up = True
        return Answer.GAVE_UP

    def _interrupted(self, used: int) -> bool:
        """Return True if a query was ended by Ctrl-C, not by its difficulty or a limit.

        z3 reports Ctrl-C in the same words as a limit.
        """
        reason, left = self._z3.reason_unknown(), self._budget.milliseconds_left
        in_time = left is None or left > _GRACE_MS
        return "interrupted" in reason or ("canceled" in reason and used < self._query_limit and in_time)

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
