"""Bounded model checking (Biere et al., 1999): the shortest traces that break a contract.

At each length frames a period apart are tried before frames at any times, as the former are easier to
believe, and traces in which no module in Python is asked before those in which one may answer anything, as
only the former refute.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import z3

from colony.verify.contracts.cone import facts, within
from colony.verify.contracts.houdini import keeps
from colony.verify.contracts.solver import Answer, Budget, Solver
from colony.verify.symbolic.cones import Cone
from colony.verify.symbolic.system import Claim, Number
from colony.verify.symbolic.unrolling import Unrolling

_REGULAR = z3.Bool("frames a period apart")
_UNASKED = z3.Bool("no module in Python is asked")


class Candidate(NamedTuple):
    """A model that breaks the contract in its last frame.

    `frames` is its length; `unasked`: it breaks the contract whatever any module in Python would answer.
    """

    model: z3.ModelRef
    frames: int
    unasked: bool


class Search:
    """Traces of growing length for one contract. Mutable: the length so far.

    `clear` is how many frames from the start are known not to break the contract, whatever is sensed.
    """

    def __init__(self, cone: Cone, claim: Claim, budget: Budget, lemmas: Sequence[z3.BoolRef] = ()) -> None:
        self.frames = Unrolling(cone.system, cone)
        self.clear = 0
        self._length = 0
        self._always_clear = True
        self._facts = facts(cone)
        self._claim = claim
        self._lemmas = lemmas
        self._solver = Solver(budget)
        self._solver.add(*self.frames.initial())
        python = cone.system.python.items()
        self._python = [cone.system.modules[m].silent for m, given in python if within(cone, given.answers)]

    @property
    def length(self) -> int:
        """The number of frames that were searched."""
        return self._length

    def longer(self, asked: bool = True) -> Iterator[Candidate]:
        """Yield models whose last frame is the next one; each differs from those before it.

        Without `asked` only those in which no module in Python is asked.
        """
        last = self._length
        self._extend(last)
        self._length += 1
        broken = z3.Not(self.frames.at(last, keeps(self._claim)))
        self._solver.push()
        try:
            self._solver.add(broken)
            for assumed in self._modes(last, asked):
                yield from self._models(assumed, last)
        finally:
            self._solver.pop()
        if self._always_clear and (asked or not self._python):
            self.clear = self._length
            self._solver.add(z3.Not(broken))

    def _models(self, assumed: list[z3.BoolRef], last: int) -> Iterator[Candidate]:
        while True:
            answer = self._solver.ask(assumed)
            if answer is Answer.UNSAT:
                return
            self._always_clear = False
            if answer is Answer.GAVE_UP:
                return
            model = self._solver.model()
            yield Candidate(model, last + 1, not self._python or _UNASKED in assumed)
            self._solver.add(self._different(model, last))

    def _modes(self, last: int, asked: bool) -> Iterator[list[z3.BoolRef]]:
        """Yield the assumptions to try in turn; the last mode allows the most."""
        without = [[_UNASKED]] if self._python else []
        for mode in (*without, *([[]] if asked or not self._python else [])):
            if last > 0:
                yield [_REGULAR, *mode]
            yield mode

    def _extend(self, frame: int) -> None:
        """Add a frame to the trace."""
        system = self.frames.cone.system
        if frame > 0:
            self._solver.add(*self.frames.moves(frame - 1))
            before, now = self.frames.at(frame - 1, system.now), self.frames.at(frame, system.now)
            self._solver.add(z3.Implies(_REGULAR, now == before + system.program.robot.frame_ns))
        self._solver.add(self.frames.at(frame, self._facts))
        for silent in self._python:
            self._solver.add(z3.Implies(_UNASKED, self.frames.at(frame, silent)))
        self._solver.add(*(self.frames.at(frame, lemma) for lemma in self._lemmas))

    def _different(self, model: z3.ModelRef, frame: int) -> z3.BoolRef:
        """Return the condition that an input of the last frame is far from its value in `model`.

        A model that does not replay is often at the very edge of a comparison: next to it others fail alike.
        """
        system = self.frames.cone.system
        differences = []
        for given in system.sensors.values():
            for scalar in given.elements:
                differences += _far(scalar, model, self.frames, frame)
            if within(self.frames.cone, given.present):
                present = self.frames.at(frame, given.present)
                differences.append(present != model.eval(present, model_completion=True))
        return z3.Or(*differences) if differences else z3.BoolVal(False)


def _far(scalar: Number | z3.BoolRef, model: z3.ModelRef, frames: Unrolling, frame: int) -> list[z3.BoolRef]:
    """Return the conditions that a value differs from a model's by more than a hundredth."""
    here = scalar.value if isinstance(scalar, Number) else scalar
    if not within(frames.cone, here):
        return []
    there = frames.at(frame, here)
    value = model.eval(there, model_completion=True)
    if not z3.is_arith(value):
        return [there != value]
    margin = z3.If(value < 0, -value, value) / 100 + z3.Q(1, 1000)
    return [z3.Or(there > value + margin, there < value - margin)]
