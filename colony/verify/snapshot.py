"""The input of the reference interpreter in one frame of a proof: readings in base units, bit for bit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from colony.ir.bearings import Bearings, between, index_text, naming_angle
from colony.ir.frame import NOTHING_GIVEN, Frame, OverriddenCommand
from colony.ir.program import Program
from colony.ir.types import ScalarValue, Type, Value, bearings_of
from colony.verify.reference.boundary import sense

# --- sparse --------------------------------------------------------------------------------------------
#
# Arrays as the commonest value and the few runs that differ from it, named as tests write them.


_MAX_RUNS = 6
"""Maximum number of differing runs; arrays with more are written in full."""

_MAX_SHOWN = 24
"""Maximum number of elements, or of runs of a longer array, that people are shown."""


class ElementRun(NamedTuple):
    """Adjacent elements with one value, from `first` to `last`, in a ring perhaps through its end."""

    first: int
    last: int
    value: ScalarValue


class Sparse(NamedTuple):
    """An array: its commonest value, and the runs of the other elements."""

    common: ScalarValue
    differing: tuple[ElementRun, ...]


def differing(
    values: tuple[ScalarValue, ...], common: tuple[ScalarValue, ...], bearings: Bearings | None
) -> tuple[ElementRun, ...] | None:
    """Return the runs that differ from `common`, by index; None if they are many."""
    found = _runs(values, common, bearings)
    return found if len(found) <= _MAX_RUNS else None


def sparse(values: tuple[ScalarValue, ...], bearings: Bearings | None) -> Sparse | None:
    """Return an array as its commonest value and the others; None if many runs differ from it."""
    common = _commonest(values)
    others = differing(values, (common,) * len(values), bearings)
    return None if others is None else Sparse(common, others)


def sparse_text(
    values: tuple[ScalarValue, ...], type_: Type, text: Callable[[ScalarValue], str]
) -> str | None:
    """Return `all 5 m, [-30 deg .. 30 deg] 0.4 m`; None for a short array of which many elements differ."""
    common, bearings = _commonest(values), bearings_of(type_)
    runs = _runs(values, (common,) * len(values), bearings)
    if len(runs) > _MAX_RUNS and len(values) <= _MAX_SHOWN:
        return None
    parts = [f"[{run_text(bearings, run)}] {text(run.value)}" for run in runs[:_MAX_SHOWN]]
    if len(runs) > _MAX_SHOWN:
        parts.append(f"and {len(runs) - _MAX_SHOWN} more ranges")
    return ", ".join((f"all {text(common)}", *parts))


def run_text(bearings: Bearings | None, run: ElementRun) -> str:
    """Return the index or slice of a run: `-30 deg .. 30 deg`, `3..7` if no angles name it."""
    if run.first == run.last:
        return index_text(bearings, run.first)
    angles = run_angles(bearings, run)
    return f"{run.first}..{run.last}" if angles is None else f"{angles[0]} deg .. {angles[1]} deg"


def run_angles(bearings: Bearings | None, run: ElementRun) -> tuple[str, str] | None:
    """Return the angles of a slice that selects exactly a run; None if no such angles name it."""
    ends = naming_angle(bearings, run.first), naming_angle(bearings, run.last)
    if bearings is None or ends[0] is None or ends[1] is None:
        return None
    expected = _indices(run, len(bearings.angles))
    clockwise = (ends[1], ends[0])
    for low, high in ((ends[0], ends[1]), clockwise):
        selected = between(bearings, float(low), float(high))
        if len(selected) == len(expected) and set(selected) == expected:
            return low, high
    return None


def _commonest(values: tuple[ScalarValue, ...]) -> ScalarValue:
    [(common, _), *_] = Counter(values).most_common(1)
    return common


def _indices(run: ElementRun, size: int) -> set[int]:
    if run.first <= run.last:
        return set(range(run.first, run.last + 1))
    return {*range(run.first, size), *range(run.last + 1)}


def _runs(
    values: tuple[ScalarValue, ...], common: tuple[ScalarValue, ...], bearings: Bearings | None
) -> tuple[ElementRun, ...]:
    """Return the runs of equal elements that differ from `common`."""
    runs = list(_runs_by_index(values, common))
    if len(runs) < 2 or bearings is None:
        return tuple(runs)
    first, last = runs[0], runs[-1]
    joined = ElementRun(last.first, first.last, first.value)
    meet = first.first == 0 and last.last == len(values) - 1 and first.value == last.value
    if meet and run_angles(bearings, joined) is not None:
        return (*runs[1:-1], joined)
    return tuple(runs)


def _runs_by_index(values: tuple[ScalarValue, ...], common: tuple[ScalarValue, ...]) -> Iterator[ElementRun]:
    start: int | None = None
    for i, (value, other) in enumerate(zip(values, common, strict=True)):
        if start is not None and (value == other or value != values[start]):
            yield ElementRun(start, i - 1, values[start])
            start = None
        if start is None and value != other:
            start = i
    if start is not None:
        yield ElementRun(start, len(values) - 1, values[start])


# --- snapshot ------------------------------------------------------------------------------------------


_NONE: Mapping[str, Any] = {}


class Snapshot(NamedTuple):
    """The inputs of one frame in base units; a `Frame` has them in declared units.

    Proofs need base units: a reading that is converted to its unit and back may differ in the last bit, and
    a counterexample at the edge of a comparison would then no longer break the contract.

    Attributes:
        t_ns: Time of the frame.
        readings: Value of each sensor that has one. What an actuator was given last is what the program
            itself sent, unless it has a value or None.
        answers: Command of each applicable module in Python; None for a failsafe one without an answer.
        restarted: True if memory was lost before the frame.
        given: What actuators were given that is not what the network decided.
        lost: Modules whose clients are lost, of actuators with `on_loss degrade`.
    """

    t_ns: int
    readings: Mapping[str, Value | None] = _NONE
    answers: Mapping[str, tuple[ScalarValue, ...] | None] = _NONE
    restarted: bool = False
    given: Mapping[str, OverriddenCommand] = NOTHING_GIVEN
    lost: frozenset[str] = frozenset()


def present_readings(program: Program, values: Mapping[str, Value | None]) -> dict[str, Value | None]:
    """Return `values` without those that are missing.

    None stays for what an actuator was given last: without it, it would be what the program itself sent.
    """
    sent = {s.name for s in program.robot.sensors if s.sent is not None}
    return {name: value for name, value in values.items() if value is not None or name in sent}


def snapshot_of(program: Program, frame: Frame) -> Snapshot:
    """Return a frame as the interpreter sees it: clamped to ranges, without faulty readings.

    Without a reading of what an actuator was given last, it is what the program itself sent.
    """
    sensors = (s for s in program.robot.sensors if s.name in frame.readings)
    sensed = {s.name: sense(s, frame.readings[s.name], s.factor)[0] for s in sensors}
    return Snapshot(frame.t_ns, present_readings(program, sensed), restarted=frame.restarted)
