"""Random frames for a program: readings near its thresholds, and times near its durations."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from random import Random
from typing import TypeVar, assert_never

from colony.ir import expression as ir
from colony.ir.bearings import TURN, Bearings, lookup
from colony.ir.frame import Frame, Reading
from colony.ir.program import Example, GivenReading, Program, PythonModule, Sensor, gaps_ns, is_regular
from colony.ir.types import Array, Bool, Enum, Quantity, Scalar, ScalarValue, Value, element_type
from colony.ir.walk import all_subexpressions, wiring_graph
from colony.text.units import ANGLE, TIME, Dimension
from colony.verify.snapshot import Snapshot, present_readings

# --- drawing ------------------------------------------------------------------------------------------
#
# The random choices on which all strategies are built.

T = TypeVar("T")


class Choices:
    """Choices from a source of random numbers: `random`, or one from hypothesis, which can shrink them.

    A choice shrinks to the first option, the smallest number, or False. All choices come from one
    `randoms()` rather than each from its own strategy: many strategies cost more, and hypothesis repeats the
    draws of equal strategies, which makes five of six drawn programs nearly the same.
    """

    def __init__(self, random: Random) -> None:
        self._random = random

    def up_to(self, high: int) -> int:
        """Choose a number from 0 to `high`."""
        return self._random.randint(0, high) if high > 0 else 0

    def between(self, low: int, high: int) -> int:
        """Choose a number from `low` to `high`."""
        return low + self.up_to(high - low)

    def mostly_large(self, low: int, high: int) -> int:
        """Choose a number from `low` to `high`, more often a large one."""
        return low + max(self.up_to(high - low), self.up_to(high - low))

    def pick(self, options: Sequence[T]) -> T:
        """Choose one of the options, which must not be empty."""
        return options[self.up_to(len(options) - 1)]

    def one_in(self, times: int) -> bool:
        """Choose True about once in `times` calls."""
        return self.up_to(times - 1) == times - 1


# --- readings -----------------------------------------------------------------------------------------
#
# Random readings for a sensor: at, next to and between a program's thresholds, and invalid in many ways.

ODD_READINGS: tuple[Reading, ...] = (
    None,
    math.nan,
    math.inf,
    -math.inf,
    True,
    1e300,
    10**400,
    "high",  # type: ignore[assignment]  # a faulty server sends anything
    (),
    (1.0, math.nan),
    3,
)
"""Readings that are invalid for most sensors, each for a different reason."""

PLAIN_NUMBERS = (0.0, 1.0, 2, -1, -0.0, 2.5, 100.0, 0.5, -7.25, 1e12)
"""Plain numbers in declared units, for any sensor."""

Thresholds = Mapping[Dimension, tuple[float, ...]]
"""Numbers of each dimension, in base units, sorted."""

_MAX_THRESHOLDS = 40
_MAX_BREAKS = 16


def thresholds_among(nodes: Iterable[ir.Expression]) -> Thresholds:
    """Return finite constants among expressions, sorted by dimension; at most `_MAX_THRESHOLDS` of each.

    Of elements along an angle they are the angles where the nearest one changes.
    """
    found: dict[Dimension, dict[float, None]] = {}
    for node in nodes:
        match node:
            case ir.Nearest(bearings=bearings):
                found.setdefault(ANGLE, {}).update(dict.fromkeys(_breaks_of(bearings)))
                continue
            case ir.UnaryOperation(operator=ir.Unary.NEGATE, operand=ir.Constant() as constant):
                sign = -1.0
            case ir.Constant() as constant:
                sign = 1.0
            case _:
                continue
        of = element_type(constant.type)
        if isinstance(of, Quantity):
            for value in constant.value if isinstance(constant.value, tuple) else (constant.value,):
                if math.isfinite(value):
                    found.setdefault(of.dimension, {})[sign * value] = None
    return {dimension: tuple(sorted([*of][:_MAX_THRESHOLDS])) for dimension, of in found.items()}


def _breaks_of(bearings: Bearings) -> list[float]:
    """Return angles in [-180, 180) where the nearest element changes, a few of many."""
    breaks = lookup(bearings).breaks
    some = breaks[:: -(-len(breaks) // _MAX_BREAKS)]
    return [float((Fraction(b) + TURN // 2) % TURN - TURN // 2) for b in some]


def draw_reading(choices: Choices, sensor: Sensor, thresholds: Thresholds) -> Reading:
    """Draw a reading of a sensor in its declared unit, or occasionally a missing or invalid one.

    What an actuator was given last is never infinite.
    """
    reading = _draw_reading(choices, sensor, thresholds)
    if sensor.sent is not None and isinstance(reading, int | float):
        most = sys.float_info.max
        if abs(reading) > most or abs(reading * sensor.factor) > most:
            return None
    return reading


def _draw_reading(choices: Choices, sensor: Sensor, thresholds: Thresholds) -> Reading:
    if choices.one_in(16):
        return None
    if choices.one_in(20):
        return choices.pick(ODD_READINGS)
    if not isinstance(sensor.type, Array):
        return _scalar(choices, sensor.type, sensor, thresholds)
    size = sensor.type.size
    if choices.one_in(30):
        size = max(0, size + choices.pick((1, -1)))
    elements = _elements(choices, sensor.type.element, size, sensor, thresholds)
    return tuple(elements) if choices.one_in(2) else elements


def _elements(
    choices: Choices, of: Scalar, size: int, sensor: Sensor, thresholds: Thresholds
) -> list[ScalarValue | int]:
    """Draw elements: all equal, equal except for some runs, from a few values, or independent.

    Programs compute the minimum of a region, or count the elements below a threshold. With independent
    elements the results would be nearly the same every time.
    """

    def draw() -> ScalarValue | int:
        return _scalar(choices, of, sensor, thresholds)

    kind = choices.up_to(5)
    if kind >= 5:
        return [draw() for _ in range(size)]
    values = [draw()] * size
    if kind == 4:
        few = [draw() for _ in range(choices.between(2, 4))]
        return [choices.pick(few) for _ in range(size)]
    for _ in range((0, 1, 1, 2)[kind] if size else 0):
        other, first, length = draw(), choices.up_to(size - 1), choices.between(1, max(1, size // 2))
        for i in range(first, first + length):
            values[i % size] = other
    return values


def _scalar(choices: Choices, of: Scalar, sensor: Sensor, thresholds: Thresholds) -> ScalarValue | int:
    match of:
        case Bool():
            return choices.up_to(1) == 1
        case Enum(members=members):
            value = choices.pick(members)[1]
            return int(value) if value.is_integer() and choices.one_in(3) else value
        case Quantity(dimension=dimension):
            if choices.one_in(4):
                return choices.pick(PLAIN_NUMBERS)
            bounds = [x for x in (sensor.low, sensor.high) if x is not None]
            numbers = sorted({*thresholds.get(dimension, ()), *bounds})
            return _number(choices, numbers) / sensor.factor if numbers else choices.pick(PLAIN_NUMBERS)
        case _:
            assert_never(of)


def _number(choices: Choices, numbers: list[float]) -> float:
    """Return one of the numbers, a number between or beyond them, or a float adjacent to one of them."""
    between = [a + (b - a) / 2 for a, b in pairwise(numbers)]
    beyond = [numbers[-1] * 2 + 1, numbers[0] - abs(numbers[0]) - 1]
    match choices.up_to(4):
        case 0 | 1:
            return choices.pick((*between, *beyond))
        case 2 | 3:
            return choices.pick(numbers)
        case _:
            return math.nextafter(choices.pick(numbers), choices.pick((math.inf, -math.inf)))


# --- example frames -----------------------------------------------------------------------------------
#
# Conversion of a `test` block to frames for any executor.


def snapshots_of(program: Program, example: Example) -> tuple[Snapshot, ...]:
    """Return the snapshots of an example, one per frame.

    Assignments to elements of a missing array are left out, as are readings that are too old, and the
    expectations.
    """
    return tuple(
        Snapshot(t_ns, present_readings(program, given), restarted=restarted)
        for t_ns, given, restarted in _given(program, example)
    )


def frames_of(program: Program, example: Example) -> tuple[Frame, ...]:
    """Return the same frames in declared units."""
    factors = {s.name: s.factor for s in program.robot.sensors}
    return tuple(
        Frame(
            t_ns,
            {name: _declared(value, factors[name]) for name, value in given.items()},
            restarted=restarted,
        )
        for t_ns, given, restarted in _given(program, example)
    )


def _given(program: Program, example: Example) -> Iterator[tuple[int, dict[str, Value | None], bool]]:
    readings = GivenReadings(program)
    for step in example.steps:
        for given in step.given:
            readings.give(given, step.times_ns[0])
        for i, t_ns in enumerate(step.times_ns):
            yield t_ns, readings.at(t_ns), step.restarted and i == 0


class GivenReadings:
    """The readings that an example gives. Stateful: remembers the last one of each sensor, and its age."""

    def __init__(self, program: Program) -> None:
        self._sensors = {s.name: s for s in program.robot.sensors}
        self._values: dict[str, Value | None] = {}
        self._taken_ns: dict[str, int] = {}  # only of sensors whose reading ages

    def give(self, given: GivenReading, t_ns: int) -> bool:
        """Apply an assignment of the step that begins at `t_ns`; False for an element of a missing array.

        An element that is given without an age leaves the age of its array as it is.
        """
        name = given.sensor
        before = self.value_at(name, t_ns)
        if given.index is not None and before is None:
            return False
        self._values[name] = assigned(self._sensors[name], given, before)
        if given.age_ns is not None:
            self._taken_ns[name] = t_ns - given.age_ns
        elif given.index is None:
            self._taken_ns.pop(name, None)
        return True

    def at(self, t_ns: int) -> dict[str, Value | None]:
        """Return the readings in a frame at `t_ns`; None for one that is missing, or too old."""
        return {name: self.value_at(name, t_ns) for name in self._values}

    def value_at(self, name: str, t_ns: int) -> Value | None:
        """Return the reading of a sensor at `t_ns`; None if it is missing, or too old."""
        return None if self.age_if_old(name, t_ns) is not None else self._values.get(name)

    def age_if_old(self, name: str, t_ns: int) -> int | None:
        """Return the age of a reading in nanoseconds if its sensor's `within` makes it too old at `t_ns`."""
        within_ns, taken_ns = self._sensors[name].within_ns, self._taken_ns.get(name)
        if within_ns is None or taken_ns is None or t_ns - taken_ns <= within_ns:
            return None
        return t_ns - taken_ns


def assigned(sensor: Sensor, given: GivenReading, before: Value | None) -> Value | None:
    """Return a sensor's value after an assignment; an element is set in the array `before`."""
    value = given.value
    if isinstance(value, tuple) or value is None:
        return value
    if given.index is None:
        return (value,) * sensor.type.size if isinstance(sensor.type, Array) else value
    assert isinstance(before, tuple)
    return (*before[: given.index], value, *before[given.index + 1 :])


def _declared(value: Value | None, factor: float) -> Reading:
    if isinstance(value, tuple):
        return tuple(x if isinstance(x, bool) else x / factor for x in value)
    return value if value is None or isinstance(value, bool) else value / factor


# --- frames -------------------------------------------------------------------------------------------


def draw_frame(choices: Choices, program: Program, t_ns: int) -> Frame:
    """Draw a frame; see `colony.verify.testing.strategies.frames`."""
    thresholds = thresholds_of(program)
    readings = {s.name: draw_reading(choices, s, thresholds) for s in program.robot.sensors}
    return Frame(t_ns, _some_sent(choices, program, readings))


def draw_trace(
    choices: Choices, program: Program, max_frames: int, *, mirrored: bool = False
) -> tuple[Frame, ...]:
    """Draw a trace; see `colony.verify.testing.strategies.traces`.

    With `mirrored`, arrays also recur in reverse, so that what is on one side is on the other a frame later.
    """
    thresholds = thresholds_of(program)
    # Few readings per sensor, used repeatedly, since memory has effects only if values recur. In a calm trace
    # most sensors do not change: conditions that need several readings at once hold only there. Sensors that
    # nothing reads matter only for the records about them.
    is_calm, read = choices.one_in(3), sensors_read(program)
    pools = {}
    for s in program.robot.sensors:
        is_constant = s.name not in read or (is_calm and not choices.one_in(4))
        count = 1 if is_constant else choices.mostly_large(1, 4)
        pools[s.name] = [draw_reading(choices, s, thresholds) for _ in range(count)]
        if mirrored and not is_constant:
            pools[s.name] += [x[::-1] for x in pools[s.name] if isinstance(x, list | tuple)]
    gaps = gaps_of(program)
    frames = [*_beginning_of_test(choices, program, max_frames)]
    t_ns = (
        frames[-1].t_ns + choices.pick(gaps) if frames else choices.pick((0, 1_000_000_000, 1, -50_000_001))
    )
    while not frames or (len(frames) < max_frames and choices.up_to(14) > 0):
        restarted = not frames and reads_restarted(program) and choices.one_in(2)
        readings = {name: choices.pick(pool) for name, pool in pools.items()}
        frames.append(Frame(t_ns, _some_sent(choices, program, readings), restarted=restarted))
        t_ns += choices.pick(gaps)
    return tuple(frames)


def _some_sent(choices: Choices, program: Program, readings: dict[str, Reading]) -> dict[str, Reading]:
    """Return the readings without most of those of what actuators were given last.

    Without a reading it is what the executor sent itself.
    """
    own = {s.name for s in program.robot.sensors if s.sent is not None and not choices.one_in(4)}
    return {name: reading for name, reading in readings.items() if name not in own} if own else readings


def _beginning_of_test(choices: Choices, program: Program, max_frames: int) -> tuple[Frame, ...]:
    """Return, occasionally, the beginning of a test of the program, which leads to interesting situations."""
    if not program.tests or not choices.one_in(3):
        return ()
    written = frames_of(program, choices.pick(program.tests))
    begun = written[: choices.up_to(min(len(written), max_frames - 1))]
    return begun if is_regular(program.robot, (frame.t_ns for frame in begun)) else ()


def thresholds_of(program: Program) -> Thresholds:
    """Return the constants in the program's expressions, by dimension."""
    return thresholds_among(all_subexpressions(program))


def sensors_read(program: Program) -> frozenset[str]:
    """Return the sensors that some expression or module in Python reads."""
    found: set[str] = set()
    for node in all_subexpressions(program):
        match node:
            case ir.SensorValue(name=name) | ir.Fresh(name=name, derived=False):
                found.add(name)
            case _:
                pass
    return frozenset(found)


def reads_restarted(program: Program) -> bool:
    """Return True if some expression reads `restarted`."""
    return any(isinstance(node, ir.RestartedFlag) for node in all_subexpressions(program))


# --- times ---------------------------------------------------------------------------------------


def gaps_of(program: Program) -> list[int]:
    """Return times between frames: one to three periods, and the program's durations, exactly or 1 ns off."""
    frame = program.robot.frame_ns
    gaps = {frame: None, 2 * frame: None, 3 * frame: None, 1: None}
    for duration in (*durations_of(program), *_times_compared(program)):
        for gap in (duration, duration - 1, duration + 1, duration - frame):
            if gap > 0:
                gaps[gap] = None
    shortest, longest = gaps_ns(program.robot)
    ends = (shortest, longest) if longest is not None else ()
    return [gap for gap in (*gaps, *ends) if gap >= shortest and (longest is None or gap <= longest)]


def durations_of(program: Program) -> list[int]:
    """Return the durations that the program measures, in nanoseconds, each once."""
    found: dict[int, None] = {}
    for wiring_node in wiring_graph(program).nodes:
        found[wiring_node.window_ns] = None
    for node in all_subexpressions(program):
        if isinstance(node, ir.MemoryCall):
            found[node.duration_ns] = None
    for module in program.modules:
        if isinstance(module, PythonModule) and module.rate_ns is not None:
            found[module.rate_ns] = None
    found.pop(0, None)
    return list(found)


def _times_compared(program: Program) -> list[int]:
    """Return the first few times that `elapsed` and `now` may be compared with, in nanoseconds."""
    found: dict[int, None] = {}
    for node in all_subexpressions(program):
        match node:
            case ir.Constant(type=Quantity(dimension=dimension), value=float(seconds)):
                if dimension == TIME and 0 < seconds < _MAX_WAIT_S:
                    found[round(seconds * 1e9)] = None
            case _:
                pass
    return list(found)[:8]


_MAX_WAIT_S = 86_400.0
"""Maximum time, in seconds, that is taken as a waiting time."""
