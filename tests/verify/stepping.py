"""Small programs, run frame by frame in the reference interpreter, for tests with expectations by hand."""

from __future__ import annotations

from collections.abc import Mapping

from colony.dsl.load import load_text
from colony.ir.expression import DerivedValue
from colony.ir.frame import Frame, Outcome, Reading
from colony.ir.program import Let, Program
from colony.ir.types import Value
from colony.verify.reference.interpreter import Interpreter

MS = 1_000_000

ROBOT = """
enum mood { calm = 0, alert = 67 }
robot tester {
  sensor a : bool from DServer.a
  sensor b : bool from DServer.b
  sensor c : bool from DServer.c
  sensor x : number from DServer.x
  sensor y : number from DServer.y
  sensor angle : deg from DServer.angle
  sensor feel : mood from DServer.feel
  sensor four[4] : number from DServer.four
  sensor bits[4] : bool from DServer.bits
  actuator out { v : number } to DServer.out idle hold
  actuator base { speed : m/s range -1 .. 1, turn : deg/s } to RServer.drive idle base(speed = 0, turn = 0)
}
"""

Shot = tuple[float, Mapping[str, Reading]]
"""A frame: its time in ms, and readings."""


def program(text: str) -> Program:
    """The program `text` on the robot above."""
    return load_text(ROBOT + text)


def run(of: str | Program, *shots: Shot) -> list[Outcome]:
    """The outcomes of a program over frames."""
    interpreter = Interpreter(program(of) if isinstance(of, str) else of)
    return [interpreter.step(Frame(round(t * MS), readings)) for t, readings in shots]


def winners(of: str, *shots: Shot, actuator: str = "out") -> list[str | None]:
    """Who commands `actuator` in each frame."""
    return [d.by for o in run(of, *shots) for d in o.decisions if d.actuator == actuator]


def values(expression: str, *shots: Shot, before: str = "") -> list[Value | None]:
    """The value of a file-level `let` of this expression in each frame, None where it is missing."""
    of = program(f"{before}\nlet it = {expression}\n")
    let = next(d for d in of.derived if isinstance(d, Let) and d.name == "it")
    interpreter = Interpreter(of)
    found = []
    for t, readings in shots:
        interpreter.step(Frame(round(t * MS), readings))
        found.append(interpreter.value_of(DerivedValue(type=let.expression.type, name="it")))
    return found


def value(expression: str, before: str = "", **readings: Reading) -> Value | None:
    """The value of an expression in one frame."""
    return values(expression, (0, readings), before=before)[0]


def every(period_ms: float, **readings: str) -> list[Shot]:
    """Frames `period_ms` apart of readings written one character a frame: `1`, `0`, or `.` for missing.

    `every(50, a="11.0")`: the bool a is true, true, missing, false.
    """
    count = max(len(row) for row in readings.values())
    return [
        (i * period_ms, {name: _CHARACTERS[row[i]] for name, row in readings.items()}) for i in range(count)
    ]


_CHARACTERS: dict[str, bool | None] = {"1": True, "0": False, ".": None}
