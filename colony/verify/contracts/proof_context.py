"""The context of proofs: one encoding of a program, and the contracts proved in it so far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

from colony.verify.contracts.candidates import Candidate, candidates
from colony.verify.contracts.cone import cone_of, covers
from colony.verify.contracts.houdini import invariants
from colony.verify.contracts.single_frames import SingleFrames
from colony.verify.contracts.solver import Budget
from colony.verify.contracts.walk import not_refuted
from colony.verify.symbolic.cones import Cone
from colony.verify.symbolic.system import Claim, System

_SHARE = 0.3
"""Additional share of a contract's budget for the search for invariants."""

_MAX_GUESSES = 300
"""Maximum number of guesses to try; the likelier ones come first."""


class _Cones(dict[str, Cone]):
    """The cones of the claims of a system, by name. Mutable: computed when first asked for."""

    def __init__(self, system: System, claims: Mapping[str, Claim]) -> None:
        super().__init__()
        self._system = system
        self._claims = claims

    def __missing__(self, name: str) -> Cone:
        cone = self[name] = cone_of(self._system, self._claims[name])
        return cone


class ProofContext:
    """One encoding of a program as formulas. Stateful: remembers proved contracts and found invariants."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.claims = {claim.name: claim for claim in system.claims}
        self.cones = _Cones(system, self.claims)
        self._proved: list[Claim] = []
        self._invariants: dict[frozenset[int], tuple[Candidate, ...]] = {}
        self._searched: set[frozenset[int]] = set()

    @cached_property
    def single_frames(self) -> SingleFrames:
        """The solver of single frames."""
        return SingleFrames(self.system)

    def add(self, claim: Claim) -> None:
        """Add a claim about the system."""
        self.claims[claim.name] = claim

    def record_proof(self, contract: str) -> None:
        """Record that a contract holds in every frame."""
        self._proved.append(self.claims[contract])

    def has_proved(self, contract: str) -> bool:
        """Return True if a contract is known to hold in every frame."""
        return any(claim.name == contract for claim in self._proved)

    def adopt(self, other: ProofContext) -> None:
        """Take over the cones and invariants found in a context whose system this one's extends."""
        for name, cone in other.cones.items():
            self.cones.setdefault(name, cone)
        for key, found in other._invariants.items():
            self._invariants.setdefault(key, found)
        self._searched |= other._searched

    def record_invariants(self, cone: Cone, found: Sequence[Candidate]) -> None:
        """Record that conditions hold before every frame."""
        self._invariants[cone.leaves] = (*self._invariants.get(cone.leaves, ()), *found)

    def known_invariants(self, cone: Cone) -> list[Candidate]:
        """Return the invariants found so far that depend on nothing outside a cone."""
        known = (c for key, found in self._invariants.items() if key <= cone.leaves for c in found)
        return list({c.formula.get_id(): c for c in known}.values())

    def lemmas(self, cone: Cone) -> list[Claim]:
        """Return the proved contracts that depend on nothing outside a cone."""
        return [claim for claim in self._proved if covers(cone, self.cones[claim.name])]

    def invariants(self, cone: Cone, budget: Budget) -> tuple[Candidate, ...]:
        """Return the invariants of a cone; each cone is searched only once."""
        key = cone.leaves  # it identifies a cone within its system
        if key not in self._searched:
            claims = [c for c in self.claims.values() if covers(cone, self.cones[c.name])]
            proved = self.lemmas(cone)
            unproved = [c for c in claims if c not in proved]
            search_budget = budget.scaled(_SHARE)
            guesses = not_refuted(cone, candidates(cone, tuple(claims)), search_budget)
            found = invariants(
                cone, guesses[:_MAX_GUESSES], unproved, [c.holds for c in proved], search_budget
            )
            self._searched.add(key)
            self.record_invariants(cone, found.conditions)
        return self._invariants[key]
