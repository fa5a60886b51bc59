"""The result of a contract's proof, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self, assert_never

from colony.ir.frame import Outcome
from colony.ir.program import Contract
from colony.verify.snapshot import Snapshot

if TYPE_CHECKING:
    from colony.verify.symbolic.system import Reason

RESOURCES_PER_SECOND = 7_200_000
"""Number of z3's resource units that take about a second on an ordinary machine.

No limit of the prover is in seconds of a clock: a verdict must not depend on how busy the machine is.
"""

_FRAMES_PER_DEPTH = 6
"""Maximum number of frames of a counterexample for each frame of induction depth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """The effort for each contract.

    Attributes:
        depth: Maximum k of k-induction.
        max_frames: Maximum length of a counterexample.
        resources: Limit on the work of z3 in its own units, which do not depend on the machine.
        total: Limit on all work on all contracts and lints, in the same units; None for no limit.
    """

    depth: int = 4
    max_frames: int = 24
    resources: int = 10 * RESOURCES_PER_SECOND
    total: int | None = None

    @classmethod
    def within(cls, seconds: float, *, depth: int, in_all: bool = False) -> Self:
        """Return options for about `seconds` of work, with `max_frames` in proportion to `depth`.

        The seconds are for each attempt at a contract, and with `in_all` also for all contracts together.
        """
        resources = max(1, round(seconds * RESOURCES_PER_SECOND))
        return cls(
            depth=depth,
            max_frames=max(_FRAMES_PER_DEPTH * depth, 2),
            resources=resources,
            total=resources if in_all else None,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """A run of the reference interpreter whose last frame breaks the contract.

    It is false there or, if `unknown`, unknown because it reads something missing. `needed_missing` are the
    missing sensors of which no value that was tried breaks the contract, `could_change` those of which some
    do and others do not. `found` has the values of the contract's names in the last frame, and `cause` the
    conditions that decided there.
    """

    snapshots: tuple[Snapshot, ...]
    outcomes: tuple[Outcome, ...]
    unknown: bool = False
    needed_missing: tuple[str, ...] = ()
    could_change: tuple[str, ...] = ()
    found: tuple[str, ...] = ()
    cause: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Proved:
    """A proof that the contract holds in every frame of every run, by `k`-induction with `invariants`.

    As a `Result`, it also says that the contract holds while clients are late or lost, unless it is `in
    time`: any actuators idle in any frame, and with `on_loss degrade` any clients lost. `Prover.prove`,
    `ProvedInTime.in_time` and `colony diff` use it for a proof that says nothing of such runs.

    Attributes:
        contract: The contract.
        k: Depth of the induction.
        invariants: Conditions on memory that the proof needed, and that are proved as well.
        over_reals: Places where the proof is about real numbers and floats may round; none in a `Result`
            but within `OverReals`.
        operators: True if the contract was also proved while connections outside the network command any
            actuators, within their bounds. Otherwise a command may break it, or no proof was found.
        operator_runs: Runs in which such a command breaks it: one, or none that was found; None if none was
            searched for.
    """

    contract: Contract
    k: int
    invariants: tuple[str, ...] = ()
    over_reals: tuple[Reason, ...] = ()
    operators: bool = False
    operator_runs: tuple[Trace, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ProvedInTime:
    """A proof that the contract holds in every frame of every run in which every client is in time.

    `in_time` is that proof. `trace` is a run with clients late or lost that breaks the contract. If it is
    None, it is not known whether there is one: `because` gives the reasons, one a line, and `hint` advice;
    `python_trace`, if not None, breaks it if the Python modules answer as in it.
    """

    contract: Contract
    in_time: Proved
    trace: Trace | None = None
    because: tuple[str, ...] = ()
    hint: str | None = None
    python_trace: Trace | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class OverReals:
    """A proof in which reals stand in for floats; no run that was tried breaks the contract.

    `proof` is that proof, with the places in its `over_reals` or those of its `in_time`.
    """

    contract: Contract
    proof: Proved | ProvedInTime

    @property
    def in_time(self) -> Proved:
        """The proof of runs in which every client is in time."""
        return self.proof.in_time if isinstance(self.proof, ProvedInTime) else self.proof


@dataclass(frozen=True, slots=True, kw_only=True)
class Refuted:
    """A refutation: `trace` breaks the contract."""

    contract: Contract
    trace: Trace


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """Neither proof nor refutation; `because` gives the reasons, one a line, and `hint` advice.

    `trace`, if not None, breaks the contract if the Python modules answer as in the trace.
    """

    contract: Contract
    because: tuple[str, ...]
    hint: str
    trace: Trace | None = None


Result = Proved | ProvedInTime | OverReals | Refuted | Unknown


def trace_of(result: Result) -> Trace | None:
    """Return the run that breaks a contract, None if none is known."""
    match result:
        case ProvedInTime(trace=trace, python_trace=python_trace):
            return trace or python_trace
        case Refuted(trace=trace) | Unknown(trace=trace):
            return trace
        case OverReals(proof=proof):
            return trace_of(proof)
        case Proved():
            return None
        case _:
            assert_never(result)
