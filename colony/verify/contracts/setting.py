"""A transition system in which contracts are to be proved, and what was proved in it so far."""

from __future__ import annotations

from colony.verify.contracts.candidates import Candidate, candidates
from colony.verify.contracts.cone import cone_of, covers, key_of
from colony.verify.contracts.houdini import invariants, keeps
from colony.verify.contracts.solver import Budget
from colony.verify.contracts.walk import not_refuted
from colony.verify.symbolic.cones import Cone
from colony.verify.symbolic.system import Claim, System

_SHARE = 0.3
"""The part of a contract's budget that may go, besides, into the search for invariants."""


_MOST = 300
"""Maximum number of guesses to try; likelier ones come first."""


class Setting:
    """One way of seeing a program as formulas. Mutable: what was proved of it, and the invariants found."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.claims = {claim.name: claim for claim in system.claims}
        self.cones = {claim.name: cone_of(system, claim) for claim in system.claims}
        self._proved: list[Claim] = []
        self._invariants: dict[frozenset[int], tuple[Candidate, ...]] = {}

    def proved(self, contract: str) -> None:
        """Take note of a contract that holds in every frame."""
        self._proved.append(self.claims[contract])

    def lemmas(self, cone: Cone) -> list[Claim]:
        """Return the contracts proved already that depend on nothing besides a cone."""
        return [claim for claim in self._proved if covers(cone, self.cones[claim.name])]

    def invariants(self, cone: Cone, budget: Budget) -> tuple[Candidate, ...]:
        """Return the invariants of a cone, found once."""
        key = key_of(cone)
        if key not in self._invariants:
            within = [c for c in self.system.claims if covers(cone, self.cones[c.name])]
            proved = self.lemmas(cone)
            open_ = [c for c in within if c not in proved]
            part = budget.part(_SHARE)
            guesses = not_refuted(cone, candidates(cone, tuple(within)), part)
            found = invariants(cone, guesses[:_MOST], open_, [keeps(c) for c in proved], part)
            self._invariants[key] = found.of_memory
        return self._invariants[key]
