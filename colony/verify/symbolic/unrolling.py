"""Unrolling of a system over consecutive frames: its constants renamed frame by frame."""

from __future__ import annotations

from typing import TypeVar, cast

import z3

from colony.verify.symbolic.cones import Cone, whole_cone
from colony.verify.symbolic.substitution import Substitution
from colony.verify.symbolic.system import System

TermT = TypeVar("TermT", bound=z3.ExprRef)


class Unrolling:
    """Frames 0, 1, ... of the part of `system` in `cone` (of all of it if None).

    Mutable: caches renamed terms. The constants of frame i are called `name@i`; a cell at i has its
    value before frame i.
    """

    def __init__(self, system: System, cone: Cone | None = None) -> None:
        self.system = system
        self.cone = whole_cone(system) if cone is None else cone
        self._constants = (*self.cone.constants, *(c.old for c in self.cone.cells))
        self._renamings: list[Substitution] = []

    def at(self, i: int, term: TermT) -> TermT:
        """Return `term`, which must be within the cone, in frame i."""
        while len(self._renamings) <= i:
            frame = len(self._renamings)
            renamed = [z3.Const(f"{c.decl().name()}@{frame}", c.sort()) for c in self._constants]
            self._renamings.append(Substitution(self._constants, renamed))
        return self._renamings[i](term)

    def step(self, i: int) -> tuple[z3.BoolRef, ...]:
        """Return the formulas of frame i and of its transition to frame i + 1."""
        return (*self.frame(i), *self.transition(i))

    def frame(self, i: int) -> tuple[z3.BoolRef, ...]:
        """Return the assumptions and definitions of frame i."""
        return tuple(self.at(i, x) for x in (*self.cone.assumptions, *self.cone.definitions))

    def transition(self, i: int) -> tuple[z3.BoolRef, ...]:
        """Return the equations between each cell at i + 1 and its value after frame i."""
        return tuple(cast(z3.BoolRef, self.at(i + 1, c.old) == self.at(i, c.next)) for c in self.cone.cells)

    def initial(self) -> tuple[z3.BoolRef, ...]:
        """Return the equations between each cell at 0 and its initial value."""
        return tuple(cast(z3.BoolRef, self.at(0, c.old) == c.initial) for c in self.cone.cells)

    def invariants(self, i: int) -> tuple[z3.BoolRef, ...]:
        """Return the invariants of the cells before frame i."""
        return tuple(self.at(i, x) for x in self.cone.invariants)


class OneFrame(Unrolling):
    """A single frame, in the system's own constants."""

    def at(self, i: int, term: TermT) -> TermT:
        """Return `term`; `i` is 0."""
        assert i == 0
        return term
