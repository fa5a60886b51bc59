"""What a polar picture of a frame shows, as data: a panel for each array with bearings, and the decisions."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal, assert_never

from colony.ir.bearings import Bearings, index_text
from colony.ir.frame import Frame, Reading
from colony.ir.program import Program, Sensor
from colony.ir.types import DISTANCE, Array, Bool, Enum, Quantity, bearings_of
from colony.view.polar import Scale, scale_of

Mark = Literal["reading", "limit", "infinite", "negative", "invalid"]
"""Kind of an element: a reading; one at the upper end of the sensor's range, such as a sonar without echo; an
infinite one; a negative distance; or none that the language knows, such as NaN."""

_MM_PER_M = 1000.0
_MAX_NAMED = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranges:
    """Quantities in `unit`, each with its mark; `limit` is the upper end of the range."""

    values: tuple[float, ...]
    marks: tuple[Mark, ...]
    unit: str
    scale: Scale
    limit: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class States:
    """Bools or enumerators: the index in `names` of each element, None for an invalid one."""

    states: tuple[int | None, ...]
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """An array with bearings; `content` is None if it was not read. `notes` are lines below its name."""

    name: str
    bearings: Bearings
    content: Ranges | States | None
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """A frame: a panel for each array with bearings, and lines about decisions."""

    title: str
    panels: tuple[Panel, ...]
    lines: tuple[str, ...]


def arrays_with_bearings(program: Program) -> tuple[Sensor, ...]:
    """Return the sensors that are arrays with bearings."""
    return tuple(s for s in program.robot.sensors if bearings_of(s.type) is not None)


def scene_of(
    program: Program, title: str, frame: Frame, read: Collection[str], lines: Sequence[str]
) -> Scene:
    """Return the scene of a frame.

    Args:
        program: The program that decided.
        title: What the picture is called.
        frame: The frame, in declared units.
        read: The sensors that the program does not take as missing.
        lines: Lines about the decisions.
    """
    panels = (_panel(s, frame.readings.get(s.name), s.name in read) for s in arrays_with_bearings(program))
    return Scene(title=title, panels=tuple(panels), lines=tuple(lines))


def _panel(sensor: Sensor, reading: Reading, is_read: bool) -> Panel:
    assert isinstance(sensor.type, Array)
    bearings, content = sensor.type.bearings, _content(sensor, sensor.type, reading)
    assert bearings is not None
    notes = [describe(bearings)]
    if content is not None:
        notes += _summary(bearings, content)
    if content is not None and not is_read:
        notes.append("the program takes it as missing")
    return Panel(name=sensor.name, bearings=bearings, content=content, notes=tuple(notes))


def describe(bearings: Bearings) -> str:
    """Return `ring of 24, 15 deg apart`, `arc of 9 from -20 deg to 20 deg, 5 deg apart` or `6 directions`."""
    size = len(bearings.angles)
    if size == 1:
        return f"one element at {_degrees(bearings.angles[0])}"
    if bearings.step is None:
        return f"{size} directions"
    apart = f"{_degrees(abs(bearings.step))} apart"
    if bearings.ends is None:
        return f"ring of {size}, {apart}"
    first, last = (_degrees(bearings.angles[i]) for i in bearings.ends)
    return f"arc of {size} from {first} to {last}, {apart}"


def _degrees(angle: float) -> str:
    return f"{angle:.6g} deg"


# --- content ---------------------------------------------------------------------------------------


def _content(sensor: Sensor, type_: Array, reading: Reading) -> Ranges | States | None:
    if not isinstance(reading, Sequence) or isinstance(reading, str) or len(reading) != type_.size:
        return None
    match type_.element:
        case Bool():
            states = tuple(int(x) if isinstance(x, bool) else None for x in reading)
            return States(states=states, names=("false", "true"))
        case Enum(members=members):
            numbers = [n for _, n in members]
            indices = (numbers.index(x) if x in numbers else None for x in map(_number, reading))
            return States(states=tuple(indices), names=tuple(name for name, _ in members))
        case Quantity():
            return _ranges(sensor, [_number(x) for x in reading])
        case _:
            assert_never(type_.element)


def _number(value: object) -> float:
    """Return the number that was recorded, NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _ranges(sensor: Sensor, readings: Sequence[float]) -> Ranges:
    assert isinstance(sensor.type, Array)
    is_length = sensor.type.element == DISTANCE
    factor, unit = (sensor.factor / _MM_PER_M, "m") if is_length else (1.0, sensor.unit)
    limit = None
    if sensor.high is not None and math.isfinite(sensor.high):
        limit = sensor.high / sensor.factor
    marks = tuple(_mark(x, limit, is_length) for x in readings)
    values = tuple(x * factor for x in readings)
    shown_limit = None if limit is None else limit * factor
    seen = [x for x, mark in zip(values, marks, strict=True) if mark == "reading"]
    beyond = abs(shown_limit) if shown_limit else 1.0
    return Ranges(
        values=values, marks=marks, unit=unit, scale=scale_of(seen, otherwise=beyond), limit=shown_limit
    )


def _mark(value: float, limit: float | None, is_length: bool) -> Mark:
    if math.isnan(value):
        return "invalid"
    if is_length and value < 0.0:
        return "negative"
    if math.isinf(value):
        return "infinite" if value > 0.0 else "invalid"
    return "limit" if limit is not None and value >= limit else "reading"


# --- summaries -----------------------------------------------------------------------------------


def _summary(bearings: Bearings, content: Ranges | States) -> list[str]:
    match content:
        case Ranges(values=values, marks=marks, unit=unit):
            is_length = unit == "m"
            counted = {"reading"} if is_length else {"reading", "limit"}  # a distance at the limit is no echo
            seen = [i for i, mark in enumerate(marks) if mark in counted]
            if not seen:
                return []
            word, choose = ("nearest", min) if is_length else ("highest", max)
            i = choose(seen, key=lambda k: values[k])
            return [f"{word} {quantity(values[i], unit)} at {index_text(bearings, i)}"]
        case States(states=states, names=("false", "true")):
            places = [index_text(bearings, i) for i, state in enumerate(states) if state]
            more = f" and {len(places) - _MAX_NAMED} more" if len(places) > _MAX_NAMED else ""
            return [f"true at {', '.join(places[:_MAX_NAMED])}{more}" if places else "true nowhere"]
        case States():
            return []
        case _:
            assert_never(content)


def quantity(value: float, unit: str) -> str:
    """Return a number with up to four digits, and its unit."""
    return f"{value:.4g} {unit}".rstrip()
