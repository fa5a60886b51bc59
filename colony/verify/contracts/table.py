"""A counterexample as a table: a line per frame with readings, answers and commands."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from types import MappingProxyType
from typing import NamedTuple

from colony.ir.frame import Decision, FrameEvent, OverriddenCommand
from colony.ir.program import Actuator, ActuatorField, Contract, Program, Sensor, in_declared_units
from colony.ir.types import Bool, Enum, Quantity, Scalar, ScalarValue, Value, element_type
from colony.ir.walk import actuators_named
from colony.text.units import BASE_UNITS, parse_unit
from colony.verify.contracts.results import Trace
from colony.verify.snapshot import Snapshot, sparse_text

# --- decimals -----------------------------------------------------------------------------------------
#
# Values as a person would write them in a `test`: short decimals in the declared unit.

_MAX_DIGITS = 17


class NumberText(NamedTuple):
    """A number as the language writes it: a sign, digits, and a unit if it has one."""

    digits: str
    unit: str | None
    negative: bool

    def __str__(self) -> str:
        """Return the number as the language writes it."""
        return f"{'-' if self.negative else ''}{self.digits}{f' {self.unit}' if self.unit else ''}"


def value_of(written: NumberText) -> float:
    """Return the number's value in base units: converted exactly and rounded once.

    Raises:
        OverflowError: it is too large for a float.
    """
    exact = Fraction(Decimal(written.digits)) * (parse_unit(written.unit).factor if written.unit else 1)
    value = float(exact)
    return -value if written.negative else value


def number_text(value: float, sensor: Sensor | ActuatorField) -> NumberText | None:
    """Return the shortest number in the unit of `sensor`, else in base units, that is exactly `value`.

    None if there is no such number, e.g. for a value that is not finite.
    """
    if not math.isfinite(value):
        return None
    for unit in dict.fromkeys((sensor.unit or None, _base_unit(sensor))):
        for digits in range(1, _MAX_DIGITS + 1):
            candidate = _rounded(value, unit, digits)
            if candidate is not None and _has_value(candidate, value):
                return candidate
    return None


def _has_value(written: NumberText, value: float) -> bool:
    try:
        return value_of(written) == value
    except OverflowError:
        return False


def rounded(value: float, sensor: Sensor | ActuatorField, digits: int) -> float:
    """Return `value`, in base units, rounded to a number of significant digits in the unit of `sensor`."""
    candidate = _rounded(value, sensor.unit or None, digits) if math.isfinite(value) else None
    try:
        return value if candidate is None else value_of(candidate)
    except OverflowError:
        return value


def _rounded(value: float, unit: str | None, digits: int) -> NumberText | None:
    factor = parse_unit(unit).factor if unit else Fraction(1)
    try:
        in_unit = float(Fraction(value) / factor)
    except OverflowError:
        return None
    return NumberText(plain(Decimal(f"{abs(in_unit):.{digits - 1}e}")), unit, math.copysign(1, in_unit) < 0)


def plain(number: Decimal) -> str:
    """Return the digits without an exponent where that is readable, and without needless zeros."""
    if number == 0:
        return "0"
    if -7 < number.adjusted() < 12:
        text = f"{number:f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    mantissa, _, exponent = f"{number.normalize():e}".partition("e")
    return f"{mantissa}e{int(exponent)}"


def _base_unit(sensor: Sensor | ActuatorField) -> str | None:
    type_ = element_type(sensor.type)
    if not isinstance(type_, Quantity) or not any(type_.dimension):
        return None
    text = str(type_.dimension)
    return text if text in BASE_UNITS or "/" in text or "*" in text or "^" in text else None


def seconds(t_ns: int) -> NumberText:
    """Return a time in seconds, exactly."""
    return NumberText(plain(Decimal(t_ns) / 1_000_000_000), "s", False)


# --- table --------------------------------------------------------------------------------------------


def table(program: Program, contract: Contract, trace: Trace) -> tuple[str, ...]:
    """Return the lines of the table, with a heading and notes."""
    sensors = [s for s in program.robot.sensors if any(s.name in x.readings for x in trace.snapshots)]
    actuators = _actuators(program, contract)
    modules = list(dict.fromkeys(m for s in trace.snapshots for m in s.answers))
    some_lost = any(s.lost for s in trace.snapshots)
    rows = [
        [
            "time",
            *(s.name for s in sensors),
            *(f"{m} answers" for m in modules),
            *actuators,
            *(["lost"] if some_lost else []),
        ]
    ]
    for snapshot, outcome in zip(trace.snapshots, trace.outcomes, strict=True):
        decisions = {d.actuator: d for d in outcome.decisions}
        rows.append(
            [
                f"{seconds(snapshot.t_ns)}{', restarted' if snapshot.restarted else ''}",
                *(reading_cell(s, snapshot) for s in sensors),
                *(_answer_text(program, m, snapshot) for m in modules),
                *(
                    decision_text(a, decisions[n], snapshot.given.get(n), outcome.records)
                    for n, a in actuators.items()
                ),
                *([", ".join(sorted(snapshot.lost)) or "none"] if some_lost else []),
            ]
        )
    heading, *frames = rows
    return (*aligned([heading, *folded(frames)]), *_notes(program, trace, len(sensors), actuators))


_MAX_ROWS = 40
"""Number of rows of a long run that are shown, half of them from its beginning."""


def folded(rows: list[list[str]]) -> list[list[str]]:
    """Return the rows with `...` in place of several between equal ones, which differ in their time alone."""
    shown, hidden = list[list[str]](), list[list[str]]()
    for i, row in enumerate(rows):
        if 0 < i < len(rows) - 1 and rows[i - 1][1:] == row[1:] == rows[i + 1][1:]:
            hidden.append(row)
            continue
        shown += hidden if len(hidden) == 1 else [_omitted(row)] if hidden else []
        shown.append(row)
        hidden = []
    if len(shown) <= _MAX_ROWS:
        return shown
    half = _MAX_ROWS // 2
    return [*shown[:half], _omitted(rows[0]), *shown[-half:]]


def _omitted(row: list[str]) -> list[str]:
    return ["...", *("" for _ in row[1:])]


_MAX_NAMES = 8
"""Maximum number of missing sensors in a line."""


def missing_lines(
    shown: int, needed_missing: Sequence[str], could_change: Sequence[str], sensors: int
) -> Iterator[str]:
    """Yield notes on the sensors that are missing in a run.

    Args:
        shown: the number of sensors that the table shows.
        needed_missing: names of the sensors that have to be missing.
        could_change: names of those of which some readings would change what the run shows.
        sensors: the number of all sensors.
    """
    if needed_missing:
        yield f"missing, which matters: {', '.join(needed_missing)}"
    if could_change:
        more = len(could_change) - _MAX_NAMES
        names = ", ".join(could_change[:_MAX_NAMES]) + (f" and {more} more" if more > 0 else "")
        yield f"missing, where some readings would change this: {names}"
    others = shown + len(needed_missing) + len(could_change)
    if others < sensors:
        which = "all other sensors" if others else "all sensors"
        yield f"{which}: missing (their readings make no difference)"


def _notes(program: Program, trace: Trace, sensors_shown: int, actuators: Iterable[str]) -> Iterator[str]:
    """Yield notes on a run; what actuators were sent in the last frame is in the table."""
    yield from missing_lines(
        sensors_shown, trace.needed_missing, trace.could_change, len(program.robot.sensors)
    )
    in_table = tuple(f"{name} {how}" for name in actuators for how in ("by ", "is idle"))
    found = [fact for fact in trace.found if not fact.startswith(in_table)]
    if found:
        yield f"in the last frame: {'; '.join(found)}"
    if trace.cause:
        yield f"because: {trace.cause}"


def _actuators(program: Program, contract: Contract) -> dict[str, Actuator]:
    """Return the actuators that the contract names, else all."""
    named = actuators_named(contract.expression)
    chosen = [a for a in program.robot.actuators if a.name in named] or program.robot.actuators
    return {a.name: a for a in chosen}


def reading_cell(sensor: Sensor, snapshot: Snapshot) -> str:
    """Return a sensor's reading in a frame; `as sent` if it is what the program itself sent before."""
    if sensor.sent is not None and sensor.name not in snapshot.readings:
        return "as sent"
    return reading_text(sensor, snapshot.readings.get(sensor.name))


def reading_text(sensor: Sensor, value: Value | None) -> str:
    """Return a sensor's reading in its unit: `5 m`, `all 5 m, [0 deg] 0.4 m`, `missing`.

    Where nothing was sent before, the idle command's value stands in: `none (0 mm/s stands in)`.
    """
    if value is None and sensor.sent is not None and sensor.default is not None:
        return f"none ({reading_text(sensor, sensor.default)} stands in)"
    if value is None:
        return "missing"
    if not isinstance(value, tuple):
        return _scalar_text(sensor, value)
    text = sparse_text(value, sensor.type, lambda x: _scalar_text(sensor, x))
    return text or f"[{', '.join(_scalar_text(sensor, x) for x in value)}]"


def _scalar_text(sensor: Sensor, value: ScalarValue) -> str:
    written = number_text(value, sensor)
    return _value_text(value, element_type(sensor.type), f"{value:g}" if written is None else str(written))


def _value_text(value: ScalarValue, type_: Scalar, number: str) -> str:
    """Return a bool or an enumerator by its name, and otherwise `number`."""
    if isinstance(value, bool) or isinstance(type_, Bool):
        return "true" if value else "false"
    members = type_.members if isinstance(type_, Enum) else ()
    return next((f"{type_}.{name}" for name, n in members if n == value), number)


def decision_text(
    actuator: Actuator,
    decision: Decision,
    given: OverriddenCommand | None = None,
    records: Sequence[FrameEvent] = (),
) -> str:
    """Return a decision as text: `by avoid: velocity = 150 mm/s, turn = 45 deg/s`.

    `given` is what the actuator was given whatever the network decided, if anything. `records` of the frame
    say which fields were cut: `velocity = 600 mm/s (cut to its range)`.
    """
    winner = "idle" if decision.by is None else f"by {decision.by}"
    if given is not None:
        winner = "late, idle" if given.values is None else "by an operator"
    fault = f" ({decision.fault})" if decision.fault else ""
    if decision.values is None:
        return f"{winner}{fault}: nothing is sent"
    cut = {r.subject: _CUT[r.kind] for r in records if r.kind in _CUT}
    return f"{winner}{fault}: {_fields_text(actuator, decision.values, cut)}"


_CUT = {"command clamped": " (cut to its range)", "limited": " (cut by a limit)"}


def _fields_text(
    actuator: Actuator, values: Sequence[ScalarValue], cut: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Return values in declared units."""
    units = (f" {f.unit}" if f.unit else "" for f in actuator.fields)
    names = (f"{actuator.name}.{f.name}" for f in actuator.fields)
    return ", ".join(
        f"{f.name} = {_value_text(value, f.type, f'{value:.9g}{unit}')}{cut.get(name, '')}"
        for f, value, unit, name in zip(actuator.fields, values, units, names, strict=True)
    )


def _answer_text(program: Program, module: str, snapshot: Snapshot) -> str:
    answer = snapshot.answers.get(module)
    if answer is None:
        return "no answer" if module in snapshot.answers else "nothing"
    name = next(m.actuator for m in program.modules if m.name == module)
    actuator = next((a for a in program.robot.actuators if a.name == name), None)
    if actuator is None:
        return "yes"
    return _fields_text(actuator, in_declared_units(answer, actuator.fields) or ())


def aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield rows as lines with columns of the same width."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
