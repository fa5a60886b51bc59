"""Encoding of a client list in Boolean formulas.

Its guards are replaced by equal formulas of the network where these are found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import assert_never

from colony.compile.guards import (
    Always,
    And,
    ClientList,
    Guard,
    ModuleActive,
    Never,
    Not,
    Or,
    Recently,
    operands,
)
from colony.verify.equivalence.circuit import FALSE, TRUE, Activity, Circuit
from colony.verify.equivalence.formula_index import FormulaIndex


@dataclass(frozen=True, slots=True, kw_only=True)
class ClientFormulas:
    """The formulas of a client's guard and exclusive guard.

    `solved` is true if z3 had to prove parts of them equal to formulas of the network.
    """

    module: str
    priority: int
    guard: int
    exclusive: int
    solved: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ListFormulas:
    """The clients of each actuator, in the order of the list, and the activities of observed names."""

    actuators: tuple[tuple[str, tuple[ClientFormulas, ...]], ...]
    observed: tuple[tuple[str, int], ...]


def encode_list(
    clients: ClientList, circuit: Circuit, index: FormulaIndex, activity: Mapping[str, int] | None = None
) -> ListFormulas:
    """Return the formulas of all guards; `activity` gives those of the modules, which are otherwise free."""
    guards = _Guards(circuit, index, activity)
    values: list[int] = []
    solved: list[bool] = []
    for guard in clients.guards:
        before = index.merged
        values.append(guards.formula(guard, values))
        solved.append(index.merged > before or any(solved[i] for i in operands(guard)))
    return ListFormulas(
        actuators=tuple(
            (
                actuator.actuator,
                tuple(
                    ClientFormulas(
                        module=c.module,
                        priority=c.priority,
                        guard=values[c.guard],
                        exclusive=values[c.exclusive],
                        solved=solved[c.guard] or solved[c.exclusive],
                    )
                    for c in actuator.clients
                ),
            )
            for actuator in clients.actuators
        ),
        observed=tuple((name, values[i]) for name, i in clients.observed),
    )


@dataclass(frozen=True, slots=True)
class _Guards:
    circuit: Circuit
    index: FormulaIndex
    activity: Mapping[str, int] | None

    def formula(self, guard: Guard, values: list[int]) -> int:
        match guard:
            case Always():
                return TRUE
            case Never():
                return FALSE
            case ModuleActive(module=module):
                return (
                    self.circuit.input(Activity(module)) if self.activity is None else self.activity[module]
                )
            case Not(operand=operand):
                return values[operand] ^ 1
            case And(operands=parts):
                return self.index.find(self.circuit.all([values[i] for i in parts]))
            case Or(operands=parts):
                return self.index.find(self.circuit.any([values[i] for i in parts]))
            case Recently(operand=operand, window_ns=window_ns):
                return self.index.recently(values[operand], window_ns)
            case _:
                assert_never(guard)
