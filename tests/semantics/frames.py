"""Runs as text: readings in rows below each other, a column a frame, and what every executor makes of them.

    = previous(x, 9)                 an expression, whose value is told

    t     0   1000  2000             times in milliseconds; without them, a frame every 50 ms
    a     10.                        what a bool sensor gives in each frame; `.` where it is missing
    x     1.0 2.0   .                what any other gives; `~` where the frame says nothing of it
    last.base_by_m  ~ T F            a name with blanks
    --
    it    9.0 1.0   .

In place of `= EXPRESSION`, `do EXPRESSION` is a module that sends the value to `out`; all else is a program,
with a robot of its own or the usual one. A decision is told as `module(values sent)`, with `-` for nobody and
`!` for a command that is not finite; actuators that nothing drives are left out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

from colony.dsl.load import load_text
from colony.ir.expression import DerivedValue
from colony.ir.frame import Decision, Frame, Outcome, Reading
from colony.ir.program import Let, Program
from colony.ir.types import Array, Bool, Value
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import ALL_EXECUTORS, Factory
from tests.executors import outcomes
from tests.programs import robot

MS = 1_000_000
_SENSORS = tuple(
    f"sensor {name} : {kind} from DServer.{name.partition('[')[0]}"
    for kind, names in (("bool", "p q flags[3]"), ("number", "k zero up down five[5] zeros[2]"))
    for name in names.split()
) + tuple(f"sensor {name} : number bearing 0 deg from DServer.{name[:4]}" for name in ("ring[4]", "hoop[5]"))
"""Sensors besides those of the usual robot."""

_NAMES = {"T": True, "F": False, "inf": math.inf, "nan": math.nan}


def told(given: str, executors: Mapping[str, Factory] = ALL_EXECUTORS) -> str:
    """Return what all executors do in a run that is given as text, in rows."""
    text, _, rows = given.partition("\n\n")
    lines = [row.split() for row in rows.splitlines()]
    if re.search("^= ", text, re.M):
        return _aligned(
            [["it", *map(_value, values(re.sub("^= ", "let it = ", text, flags=re.M), lines, executors))]]
        )
    text = re.sub(
        "^do (.*)$", r"module m { when true do out(v = \1) }\nnetwork { out = m }", text, flags=re.M
    )
    program = load_text(text if "robot " in text else robot(*_SENSORS) + text)
    return _aligned(_rows(program, outcomes(program, _trace(program, lines), executors)))


def literal(text: str) -> Reading:
    """Return the value that is written as in Python, or with T, F, inf and nan; `.` is None."""
    return None if text == "." else eval(text, {}, _NAMES)  # type: ignore[no-any-return]


def values(
    text: str, rows: Sequence[Sequence[str]], executors: Mapping[str, Factory] = ALL_EXECUTORS
) -> list[Value | None]:
    """Return the value of the let `it` in each frame, None where it is missing; for the interpreter as it is,
    and for all executors as a command."""
    program = load_text(robot(*_SENSORS) + text)
    (let,) = (d for d in program.derived if isinstance(d, Let) and d.name == "it")
    interpreter, trace = Interpreter(program), _trace(program, rows)
    found: list[Value | None] = []
    for frame in trace:
        interpreter.step(frame)
        found.append(interpreter.value_of(DerivedValue(type=let.expression.type, name="it")))
    telling = load_text(_telling(let) + text)
    for value, outcome in zip(found, outcomes(telling, trace, executors), strict=True):
        (sent,) = (d.values for d in outcome.decisions if d.actuator == "told")
        assert repr(sent) == repr(None if value is None else tuple(_parts(value)))
    return found


def _telling(let: Let) -> str:
    """Return the robot with an actuator for the value of a let, and the module that commands it: each number
    as it is where it is finite, and whether it is NaN and above 0."""
    kind = let.expression.type
    size = range(kind.size) if isinstance(kind, Array) else [None]
    fields, commands = [], []
    for i, element in enumerate("it" if k is None else f"it[{k}]" for k in size):
        if isinstance(kind.element if isinstance(kind, Array) else kind, Bool):
            element = f"(if {element} then 1 else 0)"
        unit = "" if str(kind).startswith(("number", "bool")) else f" / 1 {str(kind).partition('[')[0]}"
        number = f"{element}{unit}"
        fields.append(f"v{i} : number, nan{i} : bool, up{i} : bool")
        finite = f"if {number} - {number} == 0 then {number} else 0"
        commands.append(f"v{i} = {finite}, nan{i} = {number} != {number}, up{i} = {number} > 0")
    return robot(*_SENSORS, f"actuator told {{ {', '.join(fields)} }} to DServer.told idle hold") + (
        f"module teller {{ when true do told({', '.join(commands)}) }}\nnetwork {{ told = teller }}\n"
    )


def _parts(value: Value) -> Iterator[float | bool]:
    for one in value if isinstance(value, tuple) else (value,):
        yield from (float(one) if math.isfinite(one) else 0.0, one != one, one > 0)


def _trace(program: Program, rows: Sequence[Sequence[str]]) -> list[Frame]:
    kinds = {sensor.name: sensor.type for sensor in program.robot.sensors}
    written = {name.replace(" ", "_"): name for name in kinds}
    named = [(written.get(name, name), row) for name, *row in rows]
    columns = {name: _bools(*row) if isinstance(kinds.get(name), Bool) else row for name, row in named}
    count = max(map(len, columns.values()))
    assert all(len(row) == count for row in columns.values()), "rows of different lengths"
    times = columns.pop("t", None) or [str(50 * k) for k in range(count)]
    return [
        Frame(round(float(t) * MS), {name: literal(row[k]) for name, row in columns.items() if row[k] != "~"})
        for k, t in enumerate(times)
    ]


def _bools(*row: str) -> Sequence[str]:
    """Return the readings of a bool that are written a character each."""
    return [{"1": "T", "0": "F"}.get(one, one) for one in row[0]] if {*"".join(row)} <= {*"01."} else row


def _rows(program: Program, run: Sequence[Outcome]) -> Iterator[list[str]]:
    driven = {wire.actuator for wire in program.wires}
    for decisions in zip(*(outcome.decisions for outcome in run), strict=True):
        if (actuator := decisions[0].actuator) in driven:
            yield [actuator, *map(_decision, decisions)]
        else:
            assert all(decision.by is None for decision in decisions)
    for name in ("records", "breaches"):
        noted = [[_noted(one) for one in getattr(outcome, name)] for outcome in run]
        if any(noted):
            yield [name, *(",".join(one) or "." for one in noted)]


def _noted(one: str | tuple[str, str]) -> str:
    return one if isinstance(one, str) else f"{one[0].replace(' ', '-')}:{one[1]}"


def _decision(decision: Decision) -> str:
    sent = "" if decision.values is None else f"({','.join(map(_value, decision.values))})"
    return f"{decision.by or '-'}{'!' if decision.fault else ''}{sent}"


def _value(value: Value | None) -> str:
    match value:
        case None:
            return "."
        case tuple():
            return f"({','.join(map(_value, value))})"
        case bool():
            return "T" if value else "F"
        case _:
            return repr(value)


def _aligned(rows: Iterable[Sequence[str]]) -> str:
    table = list(rows)
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in table
    )
