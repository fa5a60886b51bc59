"""Contracts that say nothing."""

from __future__ import annotations

from collections.abc import Iterator, Set

from colony.ir import expression as ir
from colony.ir.expression import Expression
from colony.ir.program import Contract
from colony.text.diagnostics import Diagnostic, warning
from colony.verify.claims import FALSE, all_of, negation
from colony.verify.lints.case import Case
from colony.verify.written import written


def _silent(contract: Contract) -> str:
    return f"silent {contract.name}"


def _idle(contract: Contract) -> str:
    return f"idle {contract.name}"


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that a contract never speaks, and that the left side of an `implies` is never true."""
    for contract in case.program.contracts:
        if not case.is_own(contract.span):
            continue
        e = contract.expression
        remembers = any(isinstance(x, ir.MemoryCall) for x in ir.subexpressions(e))
        if not remembers:  # a second claim would have to share its memory
            yield _silent(contract), all_of((e, FALSE))
            if (left := _left(e)) is not None:
                yield _idle(contract), all_of((e, negation(left)))


def _left(e: Expression) -> Expression | None:
    match e:
        case ir.BinaryOperation(operator=ir.Binary.IMPLIES, left=left):
            return left
        case _:
            return None


def told(case: Case, proved: Set[str]) -> Iterator[Diagnostic]:
    """Yield the warnings about contracts that say nothing."""
    for contract in case.program.contracts:
        if _silent(contract) in proved:
            yield warning(
                "V026",
                contract.span,
                f"contract `{contract.name}` says nothing about any frame: something that it reads is always "
                "missing",
                "read what is missing with `value_or`, or leave the contract out",
            )
        elif _idle(contract) in proved and (left := _left(contract.expression)) is not None:
            yield warning(
                "V027",
                left.span,
                f"contract `{contract.name}` promises nothing: the left side of its `implies`, "
                f"`{written(left)}`, is never true",
                "correct the condition: as it stands the contract holds whatever the robot does",
            )
