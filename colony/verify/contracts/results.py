"""The result of a contract's proof, as data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self, assert_never

from colony.dsl import ast
from colony.dsl.parse import parse
from colony.ir.expression import MemoryCall, subexpressions
from colony.ir.frame import Outcome
from colony.ir.program import Contract, Program
from colony.text.diagnostics import Diagnostic, error
from colony.text.wording import counted
from colony.verify.explain.answer import explain_breach
from colony.verify.explain.text import short
from colony.verify.snapshot import Snapshot, snapshot_of
from colony.verify.testing.agreement import reference
from colony.verify.testing.differential import Breach
from colony.verify.testing.examples import facts_of_breach

if TYPE_CHECKING:
    from colony.verify.symbolic.system import Reason


RESOURCES_PER_SECOND = 7_200_000
"""Number of z3's resource units that take about a second on an ordinary machine.

No limit of the prover is in seconds of a clock: a verdict must not depend on how busy the machine is.
"""

_FRAMES_PER_DEPTH = 6
"""Maximum number of frames of a counterexample for each frame of induction depth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProofOptions:
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


def rank(result: Result) -> int:
    """Return how much a result proves: 0 for nothing, 1 over reals, 2 while clients are in time, 3 all."""
    match result:
        case Proved():
            return 3
        case ProvedInTime():
            return 2
        case OverReals():
            return 1
        case Refuted() | Unknown():
            return 0
        case _:
            assert_never(result)


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


# --- breach -------------------------------------------------------------------------------------------
#
# Refutation of a contract by a randomly drawn trace that breaks it.


def refutation(program: Program, breach: Breach) -> Refuted:
    """Return a breach as a refutation that begins at time 0; faulty readings become missing.

    Modules in Python are called.
    """
    start_ns = breach.trace[0].t_ns
    frames = tuple(frame._replace(t_ns=frame.t_ns - start_ns) for frame in breach.trace)
    snapshots = tuple(snapshot_of(program, frame) for frame in frames)
    facts = facts_of_breach(program, breach.contract.name, snapshots)
    trace = Trace(
        snapshots=snapshots,
        outcomes=reference(program, frames),
        unknown=facts.unknown,
        found=facts.found,
        cause=short(explain_breach(program, breach.contract.name, snapshots)),
    )
    return Refuted(contract=breach.contract, trace=trace)


# --- reach --------------------------------------------------------------------------------------------
#
# What a `reach` declares: some run gets to a frame in which its condition is true, every client in time.
#
# It is proved as the contract that no run does (`check_contract` makes it): what refutes that contract is the
# run that was asked for, and a proof of it is a finding.

VERDICTS = {"proved": "NEVER REACHED", "proved in time": "NEVER REACHED", "REFUTED": "reached"}
"""Verdicts of a reach, by those of the contract by which it is proved, where they differ."""

_NEVER_HINT = "declare a `reach` for each of its parts, to see which of them no run gets to"


def with_reaches(program: Program) -> Program:
    """Return the program with the contracts of its reaches after its own, by which they are proved."""
    return replace(program, contracts=(*program.contracts, *program.reaches), reaches=())


def length_text(trace: Trace) -> str:
    """Return the length of the run that reaches something."""
    return f"(in {counted(len(trace.snapshots), 'frame')})"


def never_reached(result: Result) -> Diagnostic:
    """Return the error for a reach that no run gets to."""
    message = f"no run reaches `{result.contract.name}`, whatever sensors read while every client is in time"
    return error("V015", result.contract.span, message, _NEVER_HINT)


def expectation(program: Program, reach: Contract) -> ast.Expression | None:
    """Return what a test in the main file expects in the frame that a run reaches.

    None if it cannot: a reach of another file has names of that file, and the memory of an expectation knows
    nothing of the steps before its own.
    """
    main = program.files[-1][1] if program.files else None
    if reach.span.source is not main or any(
        isinstance(x, MemoryCall) for x in subexpressions(reach.expression)
    ):
        return None
    found = (d for d in parse(reach.span.source).file.declarations if isinstance(d, ast.ContractDecl))
    return next((d.expression for d in found if d.name.start == reach.span.start), None)
