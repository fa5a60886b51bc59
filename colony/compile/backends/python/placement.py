"""Decides which values of a Code get a name in a generated program, and where they are computed."""

from __future__ import annotations

from collections.abc import Iterable

from colony.compile.backends.python.layout import Layout
from colony.compile.backends.python.ranges import Range
from colony.compile.backends.python.text import mentions_twice
from colony.execute.code import Apply, Code, OldCell, Op, Table, operands


def is_atom(op: Op) -> bool:
    """Return True if the value's text is a name or constant already."""
    return not isinstance(op, Apply | OldCell | Table)


class Placement:
    """The places where values are used and computed. Mutable: filled by `use`, then `settle`d.

    After `settle`, `uses` is the number of uses of each value, `slot` is the place where it is computed, and
    `named` is true if it gets a name there, false if it is an expression at its use.
    """

    def __init__(self, code: Code, layout: Layout, known: list[Range]) -> None:
        self.code = code
        self.layout = layout
        self._ranges = known
        self.uses = [0] * len(code.ops)
        self.slot = [-1] * len(code.ops)
        self.named = bytearray(len(code.ops))

    def use(self, value: int, slot: int, times: int = 1) -> None:
        """Record that the statement after `slot` uses `value` `times` times."""
        self.slot[value] = slot if self.uses[value] == 0 else self.layout.join(self.slot[value], slot)
        self.uses[value] += times

    def use_all(self, values: Iterable[int], slot: int) -> None:
        """Record that the statement after `slot` uses each of `values` once."""
        for value in values:
            self.use(value, slot)

    def settle(self, memory_slot: int) -> None:
        """Decide for every value, from the last to the first, since users come after what they use.

        Memory changes after `memory_slot`, so old values of cells are read there at the latest.
        """
        for at in reversed(range(len(self.code.ops))):
            if not self.uses[at]:
                continue
            op = self.code.ops[at]
            if isinstance(op, OldCell) and self.slot[at] >= memory_slot:
                self.slot[at], self.named[at] = memory_slot, True
            if self.uses[at] > 1 and not is_atom(op):
                self.named[at] = True
            twice = isinstance(op, Apply) and mentions_twice(
                op.operator, [self._ranges[i] for i in op.arguments]
            )
            for operand in operands(op):
                self.use(operand, self.slot[at], 2 if twice else 1)
