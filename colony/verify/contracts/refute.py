"""Check of z3 models: a counterexample must break the contract in the reference interpreter.

Formulas omit rounding and only bound some functions, so a model may be spurious. A model close to the edge of
a comparison often breaks the contract once its numbers are rounded.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import cached_property

from colony.execute.validity import MAX_TIME_NS
from colony.ir.frame import OverriddenCommand, Reading
from colony.ir.program import Program, PythonModule, Sensor
from colony.ir.types import Array, Bool, Enum, ScalarValue, Value, element_type
from colony.verify.contracts.concrete_runs import LongRuns, Replay, drawn_counterexample, is_stand_in
from colony.verify.contracts.results import RESOURCES_PER_SECOND, Trace
from colony.verify.contracts.search import CandidateTrace, Search
from colony.verify.contracts.slicing import slice_of
from colony.verify.contracts.solver import Deadline
from colony.verify.contracts.table import number_text, rounded
from colony.verify.snapshot import Snapshot
from colony.verify.symbolic.system import Disturbance, DisturbanceInputs
from colony.verify.symbolic.unrolling import Unrolling, snapshots
from colony.verify.testing.shrinking import Shrinker, with_reading

# --- minimize -----------------------------------------------------------------------------------------
#
# Minimization of counterexamples: fewer frames, fewer readings, rounder numbers.
#
# A change is kept only if the contract still breaks in the reference interpreter.

_PATIENCE = 1500
"""Number of frames that the interpreter computes for one trace of a small program, at most."""

_PASSES = 150
"""Number of times that the interpreter computes all of a long trace, at least."""

_SHARE_OF_MISSING = 12
"""By how much the questions about missing sensors are fewer than the runs of a minimization."""

_LEAST_TRIALS = 12
"""Number of groups of missing sensors that are tried with values at least."""

_MAX_DIGITS = 6

_MAX_CONSTANT = 4
"""Maximum number of a sensor's own readings that are tried for all frames of a run."""


def minimize(
    replay: Replay,
    snapshots: Sequence[Snapshot],
    patience: int | None = None,
    sliced: Replay | None = None,
) -> Trace:
    """Return a minimal trace whose last frame breaks the contract, from `snapshots`, which break it.

    `patience` is the maximum number of frames that the interpreter computes, by default more for a long run.
    It computes them of `sliced`, if given: the part of the program on which the contract depends.
    """
    sliced = replay if sliced is None else sliced
    robot, broken = sliced.program.robot, tuple(snapshots)[: len(sliced.run(snapshots))]
    if patience is None:
        patience = max(sliced.affordable_runs(_PATIENCE), _PASSES * len(broken))
        patience = min(patience, sliced.affordable_frames)
    shrinker = Shrinker(robot, broken, sliced.breach, _SimplerReadings(), patience)
    shrinker.run()
    shrinker.take(tuple(s._replace(restarted=False) for s in shrinker.trace))
    for module in dict.fromkeys(m for s in shrinker.trace for m in s.answers):
        for i, snapshot in enumerate(shrinker.trace):
            fewer = {m: a for m, a in snapshot.answers.items() if m != module}
            shrinker.take((*shrinker.trace[:i], snapshot._replace(answers=fewer), *shrinker.trace[i + 1 :]))
    _fewer_late(shrinker)
    facts = replay.facts(shrinker.trace)
    needed_missing, could_change = _that_matter(sliced, shrinker.trace)
    return Trace(
        snapshots=shrinker.trace,
        outcomes=replay.run(shrinker.trace),
        needed_missing=tuple(needed_missing),
        could_change=tuple(could_change),
        unknown=facts.unknown,
        found=facts.found,
        cause=replay.cause(shrinker.trace),
    )


def _fewer_late(shrinker: Shrinker[Snapshot]) -> None:
    """Try each frame with fewer idle actuators, and fewer lost modules."""
    i = 0
    while i < len(shrinker.trace):
        if not any(shrinker.take(fewer) for fewer in _with_one_fewer_late(shrinker.trace, i)):
            i += 1


def _with_one_fewer_late(trace: tuple[Snapshot, ...], i: int) -> Iterator[tuple[Snapshot, ...]]:
    """Yield the trace with one disturbed actuator, commanded value or lost module fewer in frame `i`."""
    frame = trace[i]
    for actuator in frame.given:
        others = {a: g for a, g in frame.given.items() if a != actuator}
        yield (*trace[:i], frame._replace(given=others), *trace[i + 1 :])
        values = frame.given[actuator].values or ()
        for j in (j for j, x in enumerate(values) if x):
            simpler = OverriddenCommand((*values[:j], type(values[j])(0), *values[j + 1 :]))
            yield (*trace[:i], frame._replace(given=others | {actuator: simpler}), *trace[i + 1 :])
    for module in sorted(frame.lost):
        yield (*trace[:i], frame._replace(lost=frame.lost - {module}), *trace[i + 1 :])


def _that_matter(replay: Replay, snapshots: tuple[Snapshot, ...]) -> tuple[list[str], list[str]]:
    """Return the missing sensors that must stay missing, and others of which a reading ends the breach.

    The trace never gives them a value. Each simple value is tried, in all frames. Sensors that may have one
    together need not be missing, and those that may have any do not matter. Of those that are left when
    patience is at its end, a reading may end the breach.
    """
    patience = max(_LEAST_TRIALS, replay.affordable_runs(_PATIENCE) // (_SHARE_OF_MISSING * len(snapshots)))
    missing = [
        (sensor.name, values)
        for sensor in replay.program.robot.sensors
        if not is_stand_in(sensor)
        and not any(sensor.name in s.readings for s in snapshots)
        and (values := _simple_values(sensor))
    ]

    def breaks(group: Sequence[tuple[str, Sequence[Value]]]) -> Iterator[bool]:
        longest = max(len(values) for _, values in group)
        return (replay.breaks(_with_values(snapshots, group, i)) for i in range(longest))

    needed, _ = _without(missing, lambda group: any(breaks(group)), patience)
    others = [(name, values) for name, values in missing if name not in needed]
    changing, left = _without(others, lambda group: all(breaks(group)), patience)
    return needed, [*changing, *left]


def _without(
    sensors: Sequence[tuple[str, Sequence[Value]]],
    may_be_dropped: Callable[[Sequence[tuple[str, Sequence[Value]]]], bool],
    patience: int,
) -> tuple[list[str], list[str]]:
    """Return the names of the sensors that cannot be dropped, alone or with others, and of those not tried.

    At most `patience` groups are tried.
    """
    found, pending = list[str](), [sensors] if sensors else []
    while pending and patience > 0:
        group, patience = pending.pop(), patience - 1
        if may_be_dropped(group):
            continue
        if len(group) == 1:
            found.append(group[0][0])
        else:
            pending += [group[len(group) // 2 :], group[: len(group) // 2]]
    return found, [name for group in reversed(pending) for name, _ in group]


def _with_values(
    snapshots: Sequence[Snapshot], group: Sequence[tuple[str, Sequence[Value]]], i: int
) -> tuple[Snapshot, ...]:
    """Return the trace with the `i`-th value, or the last, of each sensor of a group in every frame."""
    for name, values in group:
        snapshots = [with_reading(s, name, values[min(i, len(values) - 1)]) for s in snapshots]
    return tuple(snapshots)


class _SimplerReadings:
    """Simpler readings in base units: None, that of the previous frame, simple values, short numbers."""

    def in_all(self, sensor: Sensor, readings: Sequence[Reading]) -> Iterator[Reading]:
        """Yield None, each value in `readings`, and simple values; nothing if `readings` has no value."""
        if all(reading is None for reading in readings):
            return
        values = tuple(dict.fromkeys(_values(reversed(readings))))
        finite = () if all(map(_is_finite, values)) else tuple(_finite_values(sensor))
        few, simple = values[:_MAX_CONSTANT], _simple_values(sensor)
        known = (*few, *simple) if len(values) <= _MAX_CONSTANT else (*simple, *few)
        yield from dict.fromkeys((None, *finite, *known))

    def in_one(self, sensor: Sensor, reading: Reading, before: Reading) -> Iterator[Reading]:
        """Yield the previous value, None, simple values, and values with fewer distinct numbers or digits."""
        if reading == before:
            return
        yield before
        for value in _values([reading]):
            yield None
            simple = _simple_values(sensor)
            yield from simple[: simple.index(value)] if value in simple else simple
            if isinstance(value, tuple):
                yield from _fewer_distinct_numbers(value)
                for x in dict.fromkeys(value):
                    yield from (tuple(y if e == x else e for e in value) for y in _shorter(sensor, x))
            else:
                yield from _shorter(sensor, value)


def _values(readings: Iterator[Reading] | Sequence[Reading]) -> Iterator[Value]:
    """Yield the readings that are values; in a snapshot arrays are tuples."""
    for reading in readings:
        if isinstance(reading, tuple | float | bool):
            yield reading


def _fewer_distinct_numbers(value: tuple[ScalarValue, ...]) -> Iterator[Value]:
    """Yield arrays with more equal elements."""
    [(common, _), *others] = Counter(value).most_common()
    yield from ((x,) * len(value) for x in sorted(set(value)) if others)
    for j, x in enumerate(value):
        if x != common:
            yield (*value[:j], common, *value[j + 1 :])
    yield from (tuple(x if e == common else e for e in value) for x, _ in others)


def _shorter(sensor: Sensor, x: ScalarValue) -> Iterator[ScalarValue]:
    """Yield numbers close to `x` that have fewer digits in the sensor's unit; finite ones if `x` is not."""
    if isinstance(x, bool) or isinstance(element_type(sensor.type), Enum):
        return
    if not math.isfinite(x):
        yield from _finite_scalars(sensor)
        return
    text = number_text(x, sensor)
    max_digits = 17 if text is None else len(text.digits.replace(".", "").lstrip("0")) - 1
    for digits in range(1, min(max_digits, _MAX_DIGITS) + 1):
        shorter = rounded(x, sensor, digits)
        if shorter != x and _in_range(sensor, shorter):
            yield shorter


def _is_finite(value: Value) -> bool:
    return all(math.isfinite(x) for x in (value if isinstance(value, tuple) else (value,)))


def _finite_values(sensor: Sensor) -> Iterator[Value]:
    """Yield simple values and others to try in the place of one that is not finite."""
    yield from _simple_values(sensor)
    size = sensor.type.size if isinstance(sensor.type, Array) else None
    yield from (x if size is None else (x,) * size for x in _finite_scalars(sensor))


def _finite_scalars(sensor: Sensor) -> Iterator[float]:
    """Yield numbers of growing magnitude in the sensor's unit, which behave as one that is not finite may."""
    for magnitude in _MAGNITUDES:
        for x in (magnitude * sensor.factor, -magnitude * sensor.factor):
            if _in_range(sensor, x):
                yield x


_MAGNITUDES = (1.0, 10.0, 100.0, 180.0, 1e3, 1e6, 1e9)


def _in_range(sensor: Sensor, x: float) -> bool:
    return (sensor.low is None or sensor.low <= x) and (sensor.high is None or x <= sensor.high)


def _simple_values(sensor: Sensor) -> list[Value]:
    """Return simple values: the default, zero, the ends of the range; for an array, in all elements."""
    scalars = list(dict.fromkeys(_simple_scalars(sensor)))
    if isinstance(sensor.type, Array):
        return [(x,) * sensor.type.size for x in scalars]
    return [*scalars]


def _simple_scalars(sensor: Sensor) -> Iterator[ScalarValue]:
    if sensor.default is not None:
        yield sensor.default
    match element_type(sensor.type):
        case Bool():
            yield from (False, True)
        case Enum(members=members):
            yield from (n for _, n in members)
        case _:
            if _in_range(sensor, 0.0):
                yield 0.0
            yield from (x for x in (sensor.low, sensor.high) if x is not None)
            if sensor.low is None and sensor.high is None:
                yield sensor.factor


# --- refute -------------------------------------------------------------------------------------------

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
