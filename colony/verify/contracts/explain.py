"""Explanations of unknown results: the reasons, and advice."""

from __future__ import annotations

from collections.abc import Sequence

from colony.ir.program import Contract
from colony.text.wording import counted
from colony.verify.contracts.results import Trace, Unknown
from colony.verify.contracts.solver import Budget
from colony.verify.symbolic.system import Inexact, Reason

_MAX_REASONS = 3


def explain_unknown(
    contract: Contract,
    reasons: Sequence[Reason],
    budget: Budget,
    *,
    frames_searched: int,
    spurious_models: int,
    trace: Trace | None,
) -> Unknown:
    """Return the result for a contract without a proof or refutation.

    Args:
        contract: The contract.
        reasons: Reasons why formulas about it are inexact.
        budget: Its budget.
        frames_searched: Number of frames searched for a counterexample.
        spurious_models: Number of models that break it, but not in the reference interpreter.
        trace: Run that breaks it if the Python modules answer as in this run; None if there is none.
    """
    abstracted = [r for r in reasons if r.kind is Inexact.ABSTRACTED]
    python = [r for r in reasons if r.kind is Inexact.PYTHON]
    because: list[str] = []
    if trace is not None:
        because.append(
            "it is reached if modules in Python answer as below, which they need not"
            if contract.reach
            else "it is broken if modules in Python answer as below, and the prover must assume that they can"
        )
        because += _reason_lines(python)
    elif budget.deadline.is_over():
        because.append("the time limit was reached")
    elif spurious_models and abstracted:
        because.append("only bounds and signs of the following are known, which is not enough:")
        because += _reason_lines(abstracted)
    elif spurious_models:
        verb = "reach" if contract.reach else "break"
        because.append(f"real numbers can {verb} it, but none of the floats that were tried do")
    elif budget.gave_up:
        because.append("z3 reached its limits without an answer")
    if trace is None:
        depth = counted(budget.options.depth, "frame")
        claim, verb = ("that no run reaches it", "reaches") if contract.reach else ("it", "breaks")
        because.append(
            f"{claim} does not follow from what held in the {depth} before, and no run of up to "
            f"{counted(frames_searched, 'frame')} {verb} it"
        )
    return Unknown(
        contract=contract,
        because=tuple(because),
        hint=_hint(budget, abstracted, spurious_models, trace),
        trace=trace,
    )


def _reason_lines(reasons: Sequence[Reason]) -> list[str]:
    """Return the first reasons, each with its location."""
    lines = [f"  {_location(r)}{r.text}" for r in reasons[:_MAX_REASONS]]
    omitted = len(reasons) - _MAX_REASONS
    return [*lines, f"  and {omitted} more"] if omitted > 0 else lines


def _location(reason: Reason) -> str:
    source = reason.span.source
    if not source.text:
        return ""
    line, column = source.position(reason.span.start)
    return f"{source.name}:{line}:{column}: "


def _hint(budget: Budget, abstracted: Sequence[Reason], spurious_models: int, trace: Trace | None) -> str:
    if trace is not None:
        return "bound the module's command with a `limit` or a `range`, or test its class"
    if spurious_models and abstracted and not budget.deadline.is_over():
        return (
            "state what the contract needs to know about them as a condition in it, or test it with "
            "`--examples 10000`"
        )
    if budget.gave_up:
        return (
            "allow more time with `--timeout`, or split the contract: proved contracts help to prove others"
        )
    return (
        "state an invariant of its memory as a separate contract (proved contracts help to prove others), "
        "or search further with `--depth`"
    )
