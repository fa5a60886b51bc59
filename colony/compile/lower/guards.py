"""Lowering of the guards of a client list to ops."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from typing import assert_never

from colony.compile import guards as g
from colony.compile.clients import ClientList
from colony.compile.lower.builder import Builder
from colony.compile.lower.memory import MemorySite, until


class GuardLowering:
    """Lowers the guards of a client list, each on first use.

    Args:
        builder: the builder that takes the ops.
        clients: the client list.
        active: a function from a module's name to the value of the module's activity.
        name: the prefix of the names of the guards' cells.
    """

    def __init__(
        self, builder: Builder, clients: ClientList, active: Callable[[str], int], name: str = "guard"
    ) -> None:
        self.builder = builder
        self.activity_guards = dict(clients.observed)  # by name of the wire or module
        self._name = name
        self._table = clients.guards
        self._active = active
        self._windows: defaultdict[int, tuple[str, ...]] = defaultdict(tuple)
        for cell, guard in clients.windows:
            self._windows[guard] += (cell,)
        self._values: dict[int, int] = {}

    def guard(self, root: int) -> int:
        """Return the value of a guard, lowered after all of its operands."""
        if root not in self._values:
            needed, pending = {root}, [root]
            while pending:
                for operand in g.operands(self._table[pending.pop()]):
                    if operand not in needed and operand not in self._values:
                        needed.add(operand)
                        pending.append(operand)
            for index in sorted(needed):
                self._values[index] = self._guard(index)
        return self._values[root]

    def _guard(self, index: int) -> int:
        node, values, builder = self._table[index], self._values, self.builder
        match node:
            case g.Always():
                return builder.literal(True)
            case g.Never():
                return builder.literal(False)
            case g.ModuleActive(module=module):
                return self._active(module)
            case g.Not(operand=operand):
                return builder.negation(values[operand])
            case g.And(operands=operands):
                return builder.both(*[values[i] for i in operands])
            case g.Or(operands=operands):
                return builder.either(*[values[i] for i in operands])
            case g.Recently(operand=operand, window_ns=window_ns):
                site = MemorySite(
                    name=f"{self._name} {index}", cells=self._windows[index], ready=builder.literal(True)
                )
                return until(builder, values[operand], window_ns, site)
            case _:
                assert_never(node)
