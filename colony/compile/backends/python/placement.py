"""Decides which values of a `Code` get a variable in a generated program, and where they are computed."""

from __future__ import annotations

from collections.abc import Iterable

from colony.compile.backends.python.layout import Layout
from colony.compile.backends.python.ranges import Range
from colony.compile.backends.python.text import mentions_twice
from colony.execute.code import Apply, Code, OldCell, Op, Table, operands


def is_atom(op: Op) -> bool:
    """Return True if the value's text is a variable or constant anyway."""
    return not isinstance(op, Apply | OldCell | Table)


class Placement:
    """The slots at which values are computed. Mutable: filled by `use`, completed by `settle`.

    Then `uses` holds the number of uses of each value, and `slot` where it is computed; `named` is true
    if it is assigned to a variable there, false if it is an expression at its use.
    """

    def __init__(self, code: Code, layout: Layout, ranges: list[Range]) -> None:
        self.code = code
        self.layout = layout
        self._ranges = ranges
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
        """Decide for every value, from the last to the first, since a value comes after its operands.

        Memory is updated after `memory_slot`, so old values of cells are read there at the latest.
        """
        for value in reversed(range(len(self.code.ops))):
            if not self.uses[value]:
                continue
            op = self.code.ops[value]
            if isinstance(op, OldCell) and self.slot[value] >= memory_slot:
                self.slot[value], self.named[value] = memory_slot, True
            if self.uses[value] > 1 and not is_atom(op):
                self.named[value] = True
            mentioned_twice = isinstance(op, Apply) and mentions_twice(
                op.operator, [self._ranges[i] for i in op.arguments]
            )
            for operand in operands(op):
                self.use(operand, self.slot[value], 2 if mentioned_twice else 1)
