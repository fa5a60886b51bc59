"""Which claims hold in every frame of every run, and runs that break others; in bounded time."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

from colony.ir.program import Program
from colony.verify.contracts.attempt import Attempt, Proof
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.results import RESOURCES_A_SECOND, Options, Trace
from colony.verify.contracts.setting import Setting
from colony.verify.contracts.solver import Budget
from colony.verify.lints.evidence import Claims, with_claims
from colony.verify.symbolic.encode import encode
from colony.verify.symbolic.system import Inexact

_OPTIONS = Options(depth=1, longest=3, resources=RESOURCES_A_SECOND // 2)


class Prover:
    """Claims about one program. Mutable: formulas are made when they are first needed."""

    def __init__(self, program: Program, claims: Claims) -> None:
        self._program = with_claims(program, claims)

    @cached_property
    def _setting(self) -> Setting:
        return Setting(encode(self._program))

    def proved(self, names: Iterable[str]) -> frozenset[str]:
        """Those of the claims that hold always, for floats as they are."""
        return frozenset(name for name in names if self.holds(name) and not self._rounds(name))

    def holds(self, name: str) -> bool:
        """Whether a claim holds always, with real numbers in place of floats."""
        return isinstance(Attempt(self._setting, name, _budget()).run(), Proof)

    def _rounds(self, name: str) -> bool:
        return any(r.kind is Inexact.ROUNDING for r in self._setting.claims[name].inexact)

    def refuted(self, name: str) -> Trace | None:
        """A run of the reference interpreter that breaks a claim, if one is found."""
        found = Attempt(self._setting, name, _budget(), Refuter(self._program, name)).run()
        return found if isinstance(found, Trace) else None


def _budget() -> Budget:
    return Budget(_OPTIONS, lambda: 0.0)
