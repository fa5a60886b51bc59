"""Lint of contracts that constrain nothing: what they are about never happens."""

from __future__ import annotations

from collections.abc import Iterator, Set

from colony.ir import expression as ir
from colony.ir.expression import Expression
from colony.ir.program import Contract
from colony.text.diagnostics import Diagnostic, warning
from colony.verify.claims import negation
from colony.verify.lints.case import Case
from colony.verify.source_text import source_text


def _vacuous(contract: Contract) -> str:
    return f"vacuous {contract.name}"


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that the left side of a contract's `implies` is never true."""
    for contract in case.program.contracts:
        if not case.is_own(contract.span):
            continue
        left = _premise(contract.expression)
        if left is not None:
            yield _vacuous(contract), negation(left)


def _premise(e: Expression) -> Expression | None:
    match e:
        case ir.BinaryOperation(operator=ir.Binary.IMPLIES, left=left):
            return left
        case _:
            return None


def findings(case: Case, proved: Set[str]) -> Iterator[Diagnostic]:
    """Yield the warnings about contracts that constrain nothing."""
    for contract in case.program.contracts:
        if _vacuous(contract) in proved and (left := _premise(contract.expression)) is not None:
            yield warning(
                "V027",
                left.span,
                f"contract `{contract.name}` is vacuous: the left side of its `implies`, "
                f"`{source_text(left)}`, is never true",
                "correct the condition: as written, the contract holds whatever the robot does",
            )
