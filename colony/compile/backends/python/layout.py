"""The layout of a generated program: the slots at which values can be computed.

A program is a tree of regions: the body of the function, its blocks, and their branches. A region has slots
in text order, and each statement that uses values has a slot before it, where those values can be computed.
A value that is used several times is computed once, at the last slot that precedes and dominates every use:
in the innermost region around all uses, before the first of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

ROOT = 0


@dataclass(slots=True)
class Layout:
    """The regions and slots of one function, numbered in text order. Mutable."""

    _parent_slot: list[int] = field(default_factory=lambda: [-1])  # by region
    _depth: list[int] = field(default_factory=lambda: [0])  # by region
    _region: list[int] = field(default_factory=list)  # by slot
    _true_values: list[frozenset[int]] = field(default_factory=lambda: [frozenset()])  # by region

    def slot(self, region: int) -> int:
        """Return a new slot at the end of the text so far, in `region`."""
        self._region.append(region)
        return len(self._region) - 1

    def region(self, slot: int, condition: int | None = None) -> int:
        """Return a new region after `slot`, which is entered only if the value `condition` is true."""
        outer = self._region[slot]
        self._parent_slot.append(slot)
        self._depth.append(self._depth[outer] + 1)
        inherited = self._true_values[outer]
        self._true_values.append(inherited if condition is None else inherited | {condition})
        return len(self._parent_slot) - 1

    def true_values_at(self, slot: int) -> frozenset[int]:
        """Return conditions that are true whenever `slot` is reached."""
        return self._true_values[self._region[slot]]

    def join(self, a: int, b: int) -> int:
        """Return the last slot that precedes and dominates both `a` and `b`."""
        regions, parents, depths = self._region, self._parent_slot, self._depth
        while regions[a] != regions[b]:
            if depths[regions[a]] >= depths[regions[b]]:
                a = parents[regions[a]]
            else:
                b = parents[regions[b]]
        return min(a, b)
