"""The layout of a generated program: the places where the text of a value may stand.

A program is a tree of regions: the body of the function, blocks in it, branches in those. A region has slots
in the order of the text, and each statement that uses values has a slot before it, where those values can be
computed. A value used in several places is computed once, at the last slot that precedes and dominates every
use: in the innermost region around all uses, before the first of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

ROOT = 0


@dataclass(slots=True)
class Layout:
    """The regions and slots of one function, numbered in the order of the text. Mutable: it grows."""

    _parent_slot: list[int] = field(default_factory=lambda: [-1])  # by region
    _depth: list[int] = field(default_factory=lambda: [0])  # by region
    _region: list[int] = field(default_factory=list)  # by slot
    known: list[frozenset[int]] = field(default_factory=lambda: [frozenset()])  # by region: values that hold

    def slot(self, region: int) -> int:
        """Return a new slot at the end of the text so far, in `region`."""
        self._region.append(region)
        return len(self._region) - 1

    def region(self, slot: int, holds: int | None = None) -> int:
        """Return a new region after `slot`, entered only where the value `holds` is true."""
        outer = self._region[slot]
        self._parent_slot.append(slot)
        self._depth.append(self._depth[outer] + 1)
        self.known.append(self.known[outer] | {holds} if holds is not None else self.known[outer])
        return len(self._parent_slot) - 1

    def known_at(self, slot: int) -> frozenset[int]:
        """Return values that are true wherever `slot` is reached."""
        return self.known[self._region[slot]]

    def join(self, a: int, b: int) -> int:
        """Return the last slot that precedes and dominates both `a` and `b`."""
        regions, parents, depths = self._region, self._parent_slot, self._depth
        while regions[a] != regions[b]:
            if depths[regions[a]] >= depths[regions[b]]:
                a = parents[regions[a]]
            else:
                b = parents[regions[b]]
        return min(a, b)
