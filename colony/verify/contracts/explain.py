"""Explanations of unknown results: the reasons in words, and what to do about them."""

from __future__ import annotations

from collections.abc import Sequence

from colony.ir.program import Contract
from colony.text.wording import counted
from colony.verify.contracts.results import Trace, Unknown
from colony.verify.contracts.solver import Budget
from colony.verify.symbolic.system import Inexact, Reason

_MOST = 3


def unknown(
    contract: Contract,
    inexact: Sequence[Reason],
    budget: Budget,
    *,
    searched: int,
    imagined: int,
    trace: Trace | None,
) -> Unknown:
    """Return the verdict for a contract that was searched for a counterexample up to `searched` frames.

    `imagined` models broke it on paper only; `trace` breaks it if modules in Python answer so.
    """
    abstracted = [r for r in inexact if r.kind is Inexact.ABSTRACTED]
    python = [r for r in inexact if r.kind is Inexact.PYTHON]
    because: list[str] = []
    if trace is not None:
        because.append("it is broken if modules in Python answer as below, and they may answer anything")
        because += _said(python)
    elif imagined and abstracted:
        because.append("of these only bounds and signs are known, and that is too little:")
        because += _said(abstracted)
    elif imagined:
        because.append("for real numbers it can be broken; the floats that were tried do not break it")
    elif budget.gave_up:
        because.append("z3 gave up within its limits")
    if trace is None:
        before = counted(budget.options.depth, "frame")
        because.append(
            f"it does not follow from what held in the {before} before, and no run of up to "
            f"{counted(searched, 'frame')} breaks it"
        )
    return Unknown(
        contract=contract,
        because=tuple(because),
        hint=_hint(budget, abstracted, imagined, trace),
        trace=trace,
    )


def _said(reasons: Sequence[Reason]) -> list[str]:
    """Return the first reasons, each with its place."""
    lines = [f"  {_place(r)}{r.text}" for r in reasons[:_MOST]]
    more = len(reasons) - _MOST
    return [*lines, f"  and {more} more"] if more > 0 else lines


def _place(reason: Reason) -> str:
    source = reason.span.source
    if not source.text:
        return ""
    line, column = source.position(reason.span.start)
    return f"{source.name}:{line}:{column}: "


def _hint(budget: Budget, abstracted: Sequence[Reason], imagined: int, trace: Trace | None) -> str:
    if trace is not None:
        return "bound what the module may do with a `limit` or a `range`, or test the class for it"
    if imagined and abstracted:
        return "state what is needed of these as a condition of the contract, or try it: `--examples 10000`"
    if budget.gave_up:
        return (
            "give it more time with `--timeout`, or say it in parts: contracts that are proved help the rest"
        )
    return (
        "say in a contract of its own what its memory always is (what is proved helps the rest), "
        "or look further with `--depth`"
    )
