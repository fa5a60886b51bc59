"""A robot to write programs for, and short ways to check them.

The robot stands after the text, so that the text's own lines count from 1.
"""

from __future__ import annotations

from typing import TypeVar

from colony.dsl.load import check_text
from colony.ir import expression as ir
from colony.ir.program import Let, Machine, Module, Program, PythonModule, State
from colony.text.diagnostics import render

ROBOT = """
robot rome {
  frame    50 ms
  sensor   sonar[24] : mm       range 0 .. 10000          from PServer.sonar     within 300 ms
  sensor   infrared[24] : bool  bearing -180 deg          from PServer.infrared
  sensor   bumper    : bool                               from RServer.bumper
  sensor   heading   : deg                                from RServer.heading
  sensor   docked_at : number   default 0                 from DServer.DockedAt
  sensor   chance    : number                             from Runtime.random
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive   idle drive(velocity = 0, turn = 0)
  actuator lamp { on : bool, level : number range 0 .. 1 } to DServer.Lamp idle hold
}
"""

MODULES = """
module cruise { when true do drive(velocity = 300 mm/s, turn = 0) }
module avoid {
  param clearance = 600 mm
  let   near = min(sonar[11..13])
  state bumps = 0
  next  bumps = if bumper then bumps + 1 else bumps
  when  near < clearance
  do    drive(velocity = 80 mm/s, turn = 30 deg/s)
}
module blind { when not fresh(sonar) }
module shine { when true do lamp(on = true, level = 0.5) }
network { roam = avoid suppresses cruise  drive = blind inhibits roam  lamp = shine }
"""


def findings(text: str, robot: str = ROBOT) -> list[str]:
    """`line:column code` of each error and warning, in order; notes and unused modules are left out."""
    found = []
    for d in check_text(text + robot).diagnostics:
        line, column = d.span.source.position(d.span.start)
        if d.severity != "note" and d.code not in ("W001", "W002"):
            found.append(f"{line}:{column} {d.code}")
    return found


def messages(text: str, robot: str = ROBOT) -> str:
    """Everything as a person reads it, notes and warnings of unused modules left out."""
    diagnostics = check_text(text + robot).diagnostics
    return "\n".join(
        render(d) for d in diagnostics if d.severity != "note" and d.code not in ("W001", "W002")
    )


def program(text: str, robot: str = ROBOT) -> Program:
    """The program of a text that has no errors."""
    checked = check_text(text + robot)
    assert checked.program is not None, "\n".join(render(d) for d in checked.diagnostics)
    return checked.program


_Kind = TypeVar("_Kind", Let, State, Machine, Module, PythonModule)


def named(kind: type[_Kind], name: str, text: str) -> _Kind:
    """One declaration of a text that has no errors."""
    whole = program(text)
    [found] = [d for d in (*whole.derived, *whole.modules) if d.name == name and isinstance(d, kind)]
    assert isinstance(found, kind)
    return found


def expression(text: str, before: str = "") -> ir.Expression:
    """The typed expression of a text."""
    return named(Let, "x", f"{before}\nlet x = {text}\n").expression


def type_of(text: str, before: str = "") -> str:
    """The type of an expression, as messages call it."""
    return str(expression(text, before).type)


def value_of(text: str, before: str = "") -> object:
    """The value of a constant, as a param has it."""
    found = expression("p", f"{before}\nparam p = {text}")
    assert isinstance(found, ir.Constant)
    return found.value
