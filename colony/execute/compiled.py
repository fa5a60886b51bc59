"""The compiled program: the input of clients, executors, the leader and the monitor of a run.

`Compilation.compiled` lowers a program to it once; `colony.execute.colonyc` saves and reads it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Literal

from colony.execute.code import Code, ContractCode
from colony.ir.program import Robot
from colony.ir.site import Site


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceFile:
    """A source file of the program; `path` is relative, with `/` as the separator.

    Behaviors import each other by these paths, and Python modules are found by them. The path of the robot's
    body is beside that of its interface.
    """

    kind: Literal["behavior", "body", "python"]
    path: str
    data: bytes


MAX_PATH_PARTS = 64
"""Maximum number of folders in the path of a source file, the file included."""


def is_source_path(name: str) -> bool:
    """Return True if a name may be the path of a source file: it does not lead out of its folder."""
    path = PurePosixPath(name)
    is_within = 0 < len(path.parts) <= MAX_PATH_PARTS and not path.is_absolute() and ".." not in path.parts
    return is_within and "\\" not in name and "\0" not in name


@dataclass(frozen=True, slots=True, kw_only=True)
class Compiled:
    """A program, lowered to one table of operations.

    Attributes:
        name: Name of the robot.
        frame_ns: Frame period.
        code: Sensors, actuators with their prioritized clients, modules in Python, contracts and memory.
        sources: Source files; empty for a program built in memory.
        root: Path of the compiled behavior file, "" without sources.
        site: The params that a site set, which the code has; None if no site set any.
    """

    name: str
    frame_ns: int
    code: Code
    sources: tuple[SourceFile, ...] = ()
    root: str = ""
    site: Site | None = None

    @property
    def robot(self) -> Robot:
        """The program's sensors and actuators in the order declared, and the period."""
        actuators = tuple(code.actuator for code in self.code.actuators)
        return Robot(name=self.name, frame_ns=self.frame_ns, sensors=self.code.sensors, actuators=actuators)

    @property
    def contracts(self) -> tuple[ContractCode, ...]:
        """The contracts, in the order written."""
        return self.code.contracts

    @property
    def clients(self) -> tuple[tuple[str, str, int], ...]:
        """Actuator, module and priority of each client, highest priority first."""
        return tuple((a.actuator.name, c.module, c.priority) for a in self.code.actuators for c in a.clients)

    @property
    def clients_by_actuator(self) -> dict[str, tuple[str, ...]]:
        """The clients of each actuator, highest priority first."""
        return {a.actuator.name: tuple(c.module for c in a.clients) for a in self.code.actuators}

    @property
    def python_modules(self) -> tuple[str, ...]:
        """The modules in Python, in the order written; each runs in a process of its own."""
        return tuple(call.module for call in self.code.python)
