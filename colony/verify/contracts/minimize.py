"""Minimization of counterexamples: fewer frames, fewer readings, rounder numbers.

A change is kept only if the contract still breaks in the reference interpreter.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from colony.ir.frame import Given, Reading
from colony.ir.program import Sensor
from colony.ir.types import Array, Bool, Enum, ScalarValue, Value, element_type
from colony.verify.contracts.decimals import number_text, rounded
from colony.verify.contracts.replay import Replay, is_stand_in
from colony.verify.contracts.results import Trace
from colony.verify.snapshot import Snapshot
from colony.verify.testing.shrinking import Shrinker, with_reading

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
            simpler = Given((*values[:j], type(values[j])(0), *values[j + 1 :]))
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
