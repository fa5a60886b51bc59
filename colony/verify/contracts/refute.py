"""Check of a z3 model: a counterexample must break the contract in the reference interpreter.

Formulas leave rounding out and know little of some functions, so a model may break the contract only on
paper. A model close to the edge of a comparison often breaks it when its numbers are made a little rounder.
"""

from __future__ import annotations

from collections.abc import Iterator

from colony.ir.program import Program, Sensor
from colony.ir.types import Bool, Enum, Value, element_type
from colony.verify.contracts.decimals import rounded
from colony.verify.contracts.drawn import drawn
from colony.verify.contracts.minimize import minimal
from colony.verify.contracts.replay import Replay
from colony.verify.contracts.results import Trace
from colony.verify.contracts.search import Candidate, Search
from colony.verify.snapshot import Snapshot
from colony.verify.symbolic.witness import snapshots

_MODELS_A_LENGTH = 4
_MODELS = 16


class Refuter:
    """A replayer of models of one contract. Mutable: how many did not break it.

    `imagined` is the number of models that break the contract on paper only.
    """

    def __init__(self, program: Program, contract: str) -> None:
        self._program = program
        self._replays = {unasked: Replay(program, contract, unasked) for unasked in (False, True)}
        self._sensors = {s.name: s for s in program.robot.sensors}
        self._tried: dict[int, int] = {}
        self.imagined = 0

    def believe(self, candidate: Candidate, search: Search) -> Trace | None:
        """Return the minimal trace that a model leads to, None where it does not break the contract."""
        asks = candidate.unasked and bool(search.frames.cone.system.python)
        replay = self._replays[asks]
        exact = snapshots(candidate.model, search.frames, candidate.frames)
        for attempt in self._attempts(exact):
            if replay.breaks(attempt):
                return minimal(replay, attempt)
        self.imagined += 1
        self._tried[candidate.frames] = self._tried.get(candidate.frames, 0) + 1
        return None

    def drawn(self) -> Trace | None:
        """Return a minimal trace by drawing runs, in which no module in Python is asked."""
        replay = self._replays[True]
        found = drawn(self._program, replay)
        return None if found is None else minimal(replay, found)

    def patient(self, candidate: Candidate) -> bool:
        """Return True if another model of the same length is worth a try."""
        return self._tried.get(candidate.frames, 0) < _MODELS_A_LENGTH and self.imagined < _MODELS

    def _attempts(self, exact: tuple[Snapshot, ...]) -> Iterator[tuple[Snapshot, ...]]:
        """Yield a model's snapshots, and the same in rounder numbers."""
        yield exact
        for digits in (12, 6, 3, 1):
            yield tuple(self._rounded(s, digits) for s in exact)

    def _rounded(self, snapshot: Snapshot, digits: int) -> Snapshot:
        readings = {n: _rounded(v, self._sensors[n], digits) for n, v in snapshot.readings.items()}
        return snapshot._replace(readings=readings)


def _rounded(value: Value, sensor: Sensor, digits: int) -> Value:
    if isinstance(element_type(sensor.type), Bool | Enum):
        return value
    if isinstance(value, tuple):
        return tuple(rounded(x, sensor, digits) for x in value)
    return rounded(value, sensor, digits)
