"""Several frames of a system in a row: its constants renamed frame by frame."""

from __future__ import annotations

from typing import TypeVar, cast

import z3

from colony.verify.symbolic.cones import Cone, whole_cone
from colony.verify.symbolic.substitution import Substitution
from colony.verify.symbolic.system import System

Sorted = TypeVar("Sorted", bound=z3.ExprRef)


class Unrolling:
    """Frames 0, 1, ... of `system`, of what is in `cone` (all of it where that is None).

    Mutable: remembers what it has renamed. Constants of frame i are called `name@i`; a cell at i is what it
    is before frame i.
    """

    def __init__(self, system: System, cone: Cone | None = None) -> None:
        self.system = system
        self.cone = whole_cone(system) if cone is None else cone
        self._constants = (*self.cone.constants, *(c.old for c in self.cone.cells))
        self._renamings: list[Substitution] = []

    def at(self, i: int, term: Sorted) -> Sorted:
        """Return `term` in frame i. Constants outside the cone keep their names: ask only for terms in it."""
        while len(self._renamings) <= i:
            frame = len(self._renamings)
            named = [z3.Const(f"{c.decl().name()}@{frame}", c.sort()) for c in self._constants]
            self._renamings.append(Substitution(self._constants, named))
        return self._renamings[i](term)

    def step(self, i: int) -> tuple[z3.BoolRef, ...]:
        """Return the formulas of frame i, and of the memory from it to frame i + 1."""
        return (*self.frame(i), *self.moves(i))

    def frame(self, i: int) -> tuple[z3.BoolRef, ...]:
        """Return the assumptions and definitions of frame i."""
        return tuple(self.at(i, x) for x in (*self.cone.assumptions, *self.cone.definitions))

    def moves(self, i: int) -> tuple[z3.BoolRef, ...]:
        """Return the equations between each cell at i + 1 and its value after frame i."""
        return tuple(cast(z3.BoolRef, self.at(i + 1, c.old) == self.at(i, c.next)) for c in self.cone.cells)

    def initial(self) -> tuple[z3.BoolRef, ...]:
        """Return the equations between each cell at 0 and its initial value."""
        return tuple(cast(z3.BoolRef, self.at(0, c.old) == c.initial) for c in self.cone.cells)

    def invariants(self, i: int) -> tuple[z3.BoolRef, ...]:
        """Return the invariants of the cells before frame i."""
        return tuple(self.at(i, x) for x in self.cone.invariants)
