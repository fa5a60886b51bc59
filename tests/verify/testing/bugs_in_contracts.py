"""Mistakes in the three-valued logic of contracts, as they are compiled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest

from colony.compile.lower.lower import ContractLowering, KnownOp
from colony.execute.code import Commanded, Kind, Sent
from tests.verify.testing.bugs_in_passes import Plant


def lowered(method: str, change: Callable[..., Any]) -> Plant:
    """`change` a method of the lowering of contracts: it gets the original, and what that is called with."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        original = getattr(ContractLowering, method)
        monkeypatch.setattr(ContractLowering, method, lambda *args: change(original, *args))

    return plant


def unknown_holds(_: object, lowering: ContractLowering, e: Any, label: str) -> int:
    """A contract that is unknown is not broken."""
    (result,) = lowering._lower(e, label, ())
    return lowering.builder.either(lowering.builder.negation(result.known), result.value)


def strict_logic(
    _: object, lowering: ContractLowering, value: int, x: Sequence[KnownOp], settles: object
) -> KnownOp:
    """`and` and `or` are unknown wherever an operand is."""
    return KnownOp(value, lowering._all_known(x))


def both_branches(
    _: object, lowering: ContractLowering, condition: KnownOp, yes: KnownOp, no: KnownOp
) -> KnownOp:
    """`if` is unknown where the branch is that it does not choose."""
    found = ContractLowering._strict(
        lowering, lambda c, y, n: lowering.builder._select(c, y, n), condition, yes, no
    )
    return KnownOp(found.value, found.known)


def memory_of_placeholders(original: Callable[..., Any], lowering: ContractLowering, *args: Any) -> Any:
    """A memory function moves on, and is known, where its arguments are not."""
    e, arguments, *rest = args
    always = lowering.builder.literal(True)
    return original(lowering, e, [tuple(KnownOp(x.value, always) for x in a) for a in arguments], *rest)


def forgotten_commands(_: object, lowering: ContractLowering, e: Any) -> KnownOp:
    """A field of an actuator on `idle hold` is missing where nothing is sent."""
    builder = lowering.builder
    kind = lowering.names.field_kind(e.actuator, e.field_index)
    sent = builder.add(Sent(e.actuator, e.field_index), kind)
    return KnownOp(sent, builder.add(Commanded(e.actuator), Kind.BOOL))
