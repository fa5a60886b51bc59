"""Programs that tests are about: a robot with sensors of every kind, and what the compiler makes of texts."""

from __future__ import annotations

from colony.compile.lower.lower import lower
from colony.compile.pipeline import Compiled, compile_program
from colony.dsl.load import load_text
from colony.execute.code import Code
from colony.execute.executor import ClientExecutor
from colony.ir.program import Program


def robot(*more: str) -> str:
    """Return the declaration of a robot with these lines, too; `out` may hold, `base` has an idle command."""
    return f"""
enum mood {{ calm = 0, alert = 67 }}
robot tester {{
  sensor a : bool from DServer.a
  sensor b : bool from DServer.b
  sensor c : bool from DServer.c
  sensor x : number from DServer.x
  sensor y : number from DServer.y
  sensor k : number from DServer.k
  sensor angle : deg from DServer.angle
  sensor feel : mood from DServer.feel
  sensor four[4] : number from DServer.four
  sensor bits[4] : bool from DServer.bits
  actuator out {{ v : number }} to DServer.out idle hold
  actuator base {{ speed : m/s range -1 .. 1, turn : deg/s }} to RServer.drive idle base(speed = 0, turn = 0)
  {"".join(f"{line}{chr(10)}" for line in more)}}}
"""


def compiled(of: str | Program) -> Compiled:
    """Return what the compiler makes of a whole text."""
    return compile_program(load_text(of) if isinstance(of, str) else of)


def lowered(of: str | Program) -> Code:
    """Return the code of all clients of a whole text."""
    whole = compiled(of)
    return lower(whole.program, whole.clients)


def client(of: str | Program, actuator: str, module: str) -> ClientExecutor:
    """Return one client of a whole text, in its initial memory."""
    whole = compiled(of)
    return ClientExecutor(whole.program, whole.clients, actuator, module)
