"""The result of a contract's proof, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from colony.ir.frame import Outcome
from colony.ir.program import Contract
from colony.verify.snapshot import Snapshot
from colony.verify.symbolic.system import Reason

RESOURCES_A_SECOND = 7_200_000
"""Number of z3's resource units that take about a second."""

_SAFETY = 4
"""Factor by which the clock may exceed the requested time before the proof is given up."""

_LONGER = 6
"""Factor by which a counterexample may be longer than a proof may look back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """The effort for each contract.

    `depth` is the greatest k of k-induction; counterexamples are searched up to `longest` frames. `resources`
    bounds the work of z3 in its own units, which do not depend on the machine: `RESOURCES_A_SECOND` of them
    take about a second on an ordinary one. `seconds` bounds it by the clock that the caller may give, too.
    """

    depth: int = 4
    longest: int = 24
    resources: int = 10 * RESOURCES_A_SECOND
    seconds: float = 40.0

    @classmethod
    def within(cls, seconds: float, *, depth: int) -> Self:
        """Return options for about `seconds` of work, with counterexamples in proportion to `depth`."""
        return cls(
            depth=depth,
            longest=max(_LONGER * depth, 2),
            resources=max(1, round(seconds * RESOURCES_A_SECOND)),
            seconds=_SAFETY * seconds,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """A run of the reference interpreter whose last frame breaks the contract.

    `needed_missing` are sensors that the trace never gives, and that must not be there for it to break;
    `found` says what the things that the contract names are in the last frame.
    """

    snapshots: tuple[Snapshot, ...]
    outcomes: tuple[Outcome, ...]
    needed_missing: tuple[str, ...] = ()
    found: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Proved:
    """The contract holds in every frame of every run, by `k`-induction and with `invariants` in words.

    `over_reals` are the places where it was proved for real numbers and floats may round.
    """

    contract: Contract
    k: int
    invariants: tuple[str, ...] = ()
    over_reals: tuple[Reason, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Refuted:
    """A refutation: `trace` breaks the contract."""

    contract: Contract
    trace: Trace


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """Neither proof nor refutation; `because` gives the reasons, one a line, and `hint` advice.

    `trace`, where there is one, breaks the contract if the modules in Python answer as it says.
    """

    contract: Contract
    because: tuple[str, ...]
    hint: str
    trace: Trace | None = None


Result = Proved | Refuted | Unknown
