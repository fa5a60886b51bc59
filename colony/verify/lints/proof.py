"""Proofs of claims about every frame of every run, and runs that break other claims, in bounded time."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

from colony.ir.program import Program
from colony.verify.contracts.attempt import Attempt, Proof
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import RESOURCES_A_SECOND, Options, Trace
from colony.verify.contracts.setting import Setting
from colony.verify.contracts.solver import Budget, Clock
from colony.verify.lints.evidence import Claims, with_claims
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.system import Inexact

_OPTIONS = Options(depth=1, longest=3, resources=RESOURCES_A_SECOND // 2)


class Patience:
    """The time that all questions about a program may take together.

    Mutable: `left_open` counts the questions that were not asked any more. Without a clock there is no limit.
    """

    def __init__(self, clock: Clock | None = None, seconds: float = 0.0) -> None:
        self._clock = clock
        self._until = 0.0 if clock is None else clock() + seconds
        self.left_open = 0

    def over(self) -> bool:
        """Return True if no time is left for another question, and count that question as left open."""
        over = self._clock is not None and self._clock() >= self._until
        self.left_open += over
        return over


class Prover:
    """Claims about one program. Mutable: formulas are made when they are first needed."""

    def __init__(self, program: Program, claims: Claims, patience: Patience) -> None:
        self._program = with_claims(program, claims)
        self._patience = patience

    @cached_property
    def _setting(self) -> Setting:
        return Setting(encode(self._program))

    def proved(self, names: Iterable[str]) -> frozenset[str]:
        """Return the claims that are proved, for floats as they are."""
        return frozenset(name for name in names if self.holds(name) and not self._rounds(name))

    def holds(self, name: str) -> bool:
        """Return True if a claim is proved, with real numbers in place of floats."""
        if self._patience.over():
            return False
        return isinstance(Attempt(self._setting, name, _budget()).run(), Proof)

    def _rounds(self, name: str) -> bool:
        return any(r.kind is Inexact.ROUNDING for r in self._setting.claims[name].inexact)

    def refuted(self, name: str) -> Trace | None:
        """Return a run of the reference interpreter that breaks a claim, if one is found."""
        if self._patience.over():
            return None
        found = Attempt(self._setting, name, _budget(), Refuter(self._program, name)).run()
        return found if isinstance(found, Trace) else None


def _budget() -> Budget:
    return Budget(_OPTIONS, lambda: 0.0)
