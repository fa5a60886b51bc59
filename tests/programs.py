"""Programs that tests are about: a robot with sensors of every kind, and what the compiler makes of texts."""

from __future__ import annotations

from collections.abc import Mapping

from colony.compile.backends.python.generate import generate
from colony.compile.pipeline import Compilation, compile_program
from colony.dsl.load import load_text
from colony.execute.code import Code
from colony.execute.compiled import Compiled
from colony.execute.executor import ClientMemory, ClientsExecutor, ClientStep
from colony.execute.needs import whole_view
from colony.ir.frame import Answer, Frame
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
  sensor angle : deg from DServer.angle
  sensor feel : mood from DServer.feel
  sensor four[4] : number from DServer.four
  sensor bits[4] : bool from DServer.bits
  actuator out {{ v : number }} to DServer.out idle hold
  actuator base {{ speed : m/s range -1 .. 1, turn : deg/s }} to RServer.drive idle base(speed = 0, turn = 0)
  {"".join(f"{line}{chr(10)}" for line in more)}}}
"""


def compilation(of: str | Program) -> Compilation:
    """Return what the compiler makes of a whole text."""
    return compile_program(load_text(of) if isinstance(of, str) else of)


def lowered(of: str | Program) -> Code:
    """Return the code of all clients of a whole text."""
    return whole_view(compilation(of).compiled.code)


def generated(of: str | Program) -> str:
    """Return the Python that is generated for a whole text."""
    return generate(compilation(of).compiled)


class OneClient:
    """A client with a process of its own. Mutable: its memory."""

    def __init__(self, of: Compiled, actuator: str, module: str) -> None:
        self._executor = ClientsExecutor(of, ((actuator, module),))
        self._key = (actuator, module)
        self.code = self._executor.code
        self.sensors = self._executor.sensors
        self.python_modules = self._executor.python_modules
        self.restart = self._executor.restart

    def step(
        self, frame: Frame, answers: Mapping[str, Answer] | None = None, lost: frozenset[str] = frozenset()
    ) -> ClientStep:
        (step,) = self._executor.step(frame, answers, lost)
        return step

    @property
    def memory(self) -> ClientMemory:
        return self._executor.memory(self._key)

    @memory.setter
    def memory(self, memory: ClientMemory) -> None:
        self._executor.recall({self._key: memory})


def clients(of: str | Program) -> dict[tuple[str, str], OneClient]:
    """Return all clients of a whole text, by actuator and module, in their initial memory."""
    compiled = compilation(of).compiled
    return {
        (actuator, module): OneClient(compiled, actuator, module) for actuator, module, _ in compiled.clients
    }


def client(of: str | Program, actuator: str, module: str) -> OneClient:
    """Return one client of a whole text, in its initial memory."""
    return OneClient(compilation(of).compiled, actuator, module)


MS = 1_000_000


def program(text: str) -> Program:
    """Return the program of a text on the usual robot."""
    return load_text(robot() + text)
