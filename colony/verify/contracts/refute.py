"""Check of z3 models: a counterexample must break the contract in the reference interpreter.

Formulas omit rounding and only bound some functions, so a model may be spurious. A model close to the edge of
a comparison often breaks the contract once its numbers are rounded.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import cached_property

from colony.execute.validity import MAX_TIME_NS
from colony.ir.program import Program, PythonModule, Sensor
from colony.ir.types import Array, Bool, Enum, Value, element_type
from colony.verify.contracts.concrete_runs import LongRuns, drawn_counterexample
from colony.verify.contracts.decimals import rounded
from colony.verify.contracts.minimize import minimize
from colony.verify.contracts.replay import Replay
from colony.verify.contracts.results import RESOURCES_PER_SECOND, Trace
from colony.verify.contracts.search import CandidateTrace, Search
from colony.verify.contracts.slicing import slice_of
from colony.verify.contracts.solver import Deadline
from colony.verify.snapshot import Snapshot
from colony.verify.symbolic.system import Disturbance, DisturbanceInputs
from colony.verify.symbolic.unrolling import Unrolling
from colony.verify.symbolic.witness import snapshots

_MODELS_PER_LENGTH = 4
_MAX_MODELS = 16

_COST_OF_ELEMENT = RESOURCES_PER_SECOND // 20_000
"""Cost of an element of a sensor in a frame of a model, in z3's resource units."""


class Refuter:
    """Replays models of one contract. Stateful: counts the models tried, by length.

    `uncalled` are the modules in Python that a run must not call to break the contract whatever they answer:
    those in the contract's cone (`search.called_modules`), by default all. `spurious_models` is the number of
    models that do not break the contract in the interpreter. With `late`, models are of a system in which
    these inputs say what is late. `long_runs` are those of the program, if they are to be tried.
    `deadline` limits the runs.
    """

    def __init__(
        self,
        program: Program,
        contract: str,
        uncalled: Collection[str] | None = None,
        late: DisturbanceInputs | None = None,
        long_runs: LongRuns | None = None,
        deadline: Deadline | None = None,
    ) -> None:
        self._deadline = Deadline() if deadline is None else deadline
        self._late = late
        self._long_runs = long_runs
        self._contract = next(c for c in program.contracts if c.name == contract)
        self._program = program
        self._replay = Replay(program, contract, deadline=self._deadline)
        if uncalled is None:
            uncalled = [m.name for m in program.modules if isinstance(m, PythonModule)]
        self._replay_without_python = Replay(program, contract, uncalled, self._deadline)
        self._sensors = {s.name: s for s in program.robot.sensors}
        self._elements = sum(s.type.size if isinstance(s.type, Array) else 1 for s in program.robot.sensors)
        self._models_tried: dict[int, int] = {}
        self.spurious_models = 0

    def confirm(self, candidate: CandidateTrace, search: Search) -> Trace | None:
        """Return a minimal trace from a model of a search, None if the model is spurious."""
        return self.confirm_in(search.frames, candidate)

    def confirm_in(self, unrolling: Unrolling, candidate: CandidateTrace) -> Trace | None:
        """Return a minimal trace from a model of these frames, None if the model is spurious."""
        replay = self._replay_without_python if candidate.without_python else self._replay
        self._deadline.charge(candidate.frames * self._elements * _COST_OF_ELEMENT)
        exact = snapshots(candidate.model, unrolling, candidate.frames, self._late)
        for variant in self._variants(exact):
            if self._deadline.is_over():
                break
            if replay.breaks(variant):
                return self._minimal(replay, variant)
        self.spurious_models += 1
        self._models_tried[candidate.frames] = self._models_tried.get(candidate.frames, 0) + 1
        return None

    def search_runs(self, disturbance: Disturbance | None = None) -> Trace | None:
        """Return a minimal trace from concrete runs that call no Python module, None if none breaks it.

        Long runs and tests are tried first, unless there is a disturbance.
        """
        replay = self._replay_without_python
        if self._deadline.is_over():
            return None
        self._deadline.begin_stage("trying tests and long runs")
        if self._long_runs is not None and disturbance is None:
            broken = self._long_runs.breaking(self._contract.name)
            found = tuple(_within(snapshot, self._slice) for snapshot in broken or ())
            if replay.breaks(found):
                return self._minimal(replay, found)
        self._deadline.begin_stage("drawing runs")
        drawn = drawn_counterexample(self._slice, self._sliced(replay), disturbance)
        return self._minimal(replay, drawn) if drawn is not None and replay.breaks(drawn) else None

    @cached_property
    def _slice(self) -> Program:
        return slice_of(self._program, self._contract)

    def _sliced(self, replay: Replay) -> Replay:
        uncalled = [m.name for m in self._slice.modules if m.name in replay.uncalled]
        return Replay(self._slice, self._contract.name, uncalled, self._deadline)

    def _minimal(self, replay: Replay, snapshots: tuple[Snapshot, ...]) -> Trace:
        self._deadline.begin_stage("shortening a run that breaks it")
        within, sliced = tuple(_within(s, self._slice) for s in snapshots), self._sliced(replay)
        if sliced.breaks(within) and replay.breaks(within):
            return minimize(replay, within, sliced=sliced)
        return minimize(replay, snapshots)

    def may_try_more(self, candidate: CandidateTrace) -> bool:
        """Return True if another model of the same length is worth a try."""
        return (
            self._models_tried.get(candidate.frames, 0) < _MODELS_PER_LENGTH
            and self.spurious_models < _MAX_MODELS
        )

    def _variants(self, exact: tuple[Snapshot, ...]) -> Iterator[tuple[Snapshot, ...]]:
        """Yield a model's snapshots, then the same with rounded numbers; none at a time that cannot come."""
        if exact[-1].t_ns >= MAX_TIME_NS:
            return
        yield exact
        tried = [exact]
        for digits in (12, 6, 3, 1):
            variant = tuple(self._rounded(s, digits) for s in exact)
            if variant not in tried:
                tried.append(variant)
                yield variant

    def _rounded(self, snapshot: Snapshot, digits: int) -> Snapshot:
        readings = {
            name: None if value is None else _rounded(value, self._sensors[name], digits)
            for name, value in snapshot.readings.items()
        }
        return snapshot._replace(readings=readings)


def _within(snapshot: Snapshot, program: Program) -> Snapshot:
    """Return a snapshot without what is not declared in `program`, a slice."""
    sensors = {s.name for s in program.robot.sensors}
    actuators = {a.name for a in program.robot.actuators}
    modules = {m.name for m in program.modules}
    return snapshot._replace(
        readings={n: x for n, x in snapshot.readings.items() if n in sensors},
        answers={n: x for n, x in snapshot.answers.items() if n in modules},
        given={n: x for n, x in snapshot.given.items() if n in actuators},
        lost=snapshot.lost & modules,
    )


def _rounded(value: Value, sensor: Sensor, digits: int) -> Value:
    if isinstance(element_type(sensor.type), Bool | Enum):
        return value
    if isinstance(value, tuple):
        shorter = {x: rounded(x, sensor, digits) for x in dict.fromkeys(value)}
        return tuple(shorter[x] for x in value)
    return rounded(value, sensor, digits)
