"""Guards of the clients' table in terms of ops."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from typing import assert_never

from colony.compile import guards as g
from colony.compile.clients import ClientList
from colony.compile.lower.builder import Builder
from colony.compile.lower.memory import MemorySite, until


class GuardLowering:
    """A lowering of a client list's guards, on first use.

    `name` begins the names of their cells; `active` gives the value of a module's activity.
    """

    def __init__(
        self, builder: Builder, clients: ClientList, active: Callable[[str], int], name: str = "guard"
    ) -> None:
        self.builder = builder
        self.observed = dict(clients.observed)
        self._name = name
        self._table = clients.guards
        self._active = active
        self._windows: defaultdict[int, tuple[str, ...]] = defaultdict(tuple)
        for cell, guard in clients.windows:
            self._windows[guard] += (cell,)
        self._values: dict[int, int] = {}

    def guard(self, root: int) -> int:
        """Return the value of a guard, lowered with its operands, from the front of the table."""
        if root not in self._values:
            needed, work = {root}, [root]
            while work:
                for operand in g.operands(self._table[work.pop()]):
                    if operand not in needed and operand not in self._values:
                        needed.add(operand)
                        work.append(operand)
            for at in sorted(needed):
                self._values[at] = self._guard(at)
        return self._values[root]

    def _guard(self, at: int) -> int:
        node, values, builder = self._table[at], self._values, self.builder
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
                place = MemorySite(
                    name=f"{self._name} {at}", cells=self._windows[at], ready=builder.literal(True)
                )
                return until(builder, values[operand], window_ns, place)
            case _:
                assert_never(node)
