"""Refutation of a contract by a randomly drawn trace that breaks it."""

from __future__ import annotations

from colony.ir.program import Program
from colony.verify.contracts.results import Refuted, Trace
from colony.verify.explain.runs import explain_breach
from colony.verify.explain.text import short
from colony.verify.snapshot import snapshot_of
from colony.verify.testing.agreement import reference
from colony.verify.testing.differential import Breach
from colony.verify.testing.examples import facts_of_breach


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
