"""Proofs and refutations of claims about every frame of every run, in bounded effort."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property

from colony.ir.program import Program
from colony.verify.contracts.attempt import Attempt, Proof
from colony.verify.contracts.proof_context import ProofContext
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import RESOURCES_PER_SECOND, Options, Trace
from colony.verify.contracts.search import called_modules
from colony.verify.contracts.solver import Budget
from colony.verify.lints.evidence import Claims, with_claims
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.system import Inexact

MAX_FRAMES = 8
"""Maximum length of a run: a machine may come through several phases before what is looked for happens."""

OPTIONS = Options(depth=1, max_frames=MAX_FRAMES, resources=RESOURCES_PER_SECOND // 2)


_QUESTION_RESOURCES = RESOURCES_PER_SECOND // 20
"""Resources that a question is charged besides those of z3, for its encoding and the runs that are drawn."""


class Effort:
    """A limit on z3's resources for all questions about a program together; unlimited if it is None.

    Stateful: `questions_skipped` counts the questions that were left out because the limit was reached.
    """

    def __init__(self, resources: int | None = None) -> None:
        self._left = math.inf if resources is None else resources
        self.questions_skipped = 0

    def charge(self, resources: int) -> None:
        """Subtract the cost of a query."""
        self._left -= resources

    def allows_question(self) -> bool:
        """Return True if another question may be asked, and charge it; otherwise count it as skipped."""
        if self._left <= 0:
            self.questions_skipped += 1
            return False
        self.charge(_QUESTION_RESOURCES)
        return True


class Prover:
    """A prover of claims about one program. Stateful: encodes the program on first use, remembers answers."""

    def __init__(self, program: Program, claims: Claims, effort: Effort) -> None:
        self._program = with_claims(program, claims)
        self._effort = effort
        self._answers: dict[str, bool] = {}
        self._undecided: set[str] = set()

    @cached_property
    def _context(self) -> ProofContext:
        return ProofContext(encode(self._program))

    def has(self, name: str) -> bool:
        """Return True if there is a claim of this name."""
        return any(c.name == name for c in self._program.contracts)

    def proved(self, names: Iterable[str]) -> frozenset[str]:
        """Return the claims that are proved for floats, rounding included."""
        return frozenset(
            name for name in names if self.proved_over_reals(name) and not self._depends_on_rounding(name)
        )

    def proved_over_reals(self, name: str) -> bool:
        """Return True if a claim is proved over the reals, that is, without rounding."""
        if name not in self._answers:
            if not self._effort.allows_question():
                return False
            attempt = Attempt(self._context, name, Budget(OPTIONS, self._effort.charge))
            self._answers[name] = isinstance(attempt.run(), Proof)
        return self._answers[name]

    def _depends_on_rounding(self, name: str) -> bool:
        return any(r.kind is Inexact.ROUNDING for r in self._context.claims[name].inexact)

    def refuted(self, name: str) -> Trace | None:
        """Return a run of the reference interpreter that breaks a claim, if one is found.

        Modules in Python answer in it as suits the run.
        """
        if not self._effort.allows_question():
            return None
        refuter = Refuter(self._program, name, called_modules(self._context.cones[name]))
        attempt = Attempt(self._context, name, Budget(OPTIONS, self._effort.charge), refuter)
        found = attempt.run()
        if isinstance(found, Proof):
            return None
        trace = found or attempt.python_trace or refuter.search_runs()
        if trace is None:
            self._undecided.add(name)
        return trace

    def is_undecided(self, name: str) -> bool:
        """Return True if a claim was asked to be refuted, and was neither refuted nor proved."""
        return name in self._undecided
