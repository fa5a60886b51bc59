"""The compiled program in the shapes in which the processes of the runtime execute it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from colony.compile.clients import ClientList
from colony.compile.executor import ClientExecutor, ClientListExecutor
from colony.ir.expression import IsActive
from colony.ir.frame import Executor, Frame
from colony.ir.program import Contract, Program, PythonModule
from colony.ir.types import BOOL
from colony.runtime import topics
from colony.runtime.assembly import Assembled
from colony.runtime.client import Slice
from colony.runtime.messages import Request


class ClientSlice(NamedTuple):
    """One client: its step, the sensors that it reads, the modules in Python whose activity it needs."""

    step: Slice
    sensors: tuple[str, ...]
    outside: tuple[str, ...]


def client_slice(program: Program, clients: ClientList, actuator: str, module: str) -> ClientSlice:
    """The client that `module` is for `actuator`.

    Raises:
        Failure: its module in Python cannot be imported or built.
    """
    executor = ClientExecutor(program, clients, actuator, module)

    def step(assembled: Assembled) -> Request:
        lost = frozenset(map(topics.module_of, assembled.tick.lost))
        took = executor.step(assembled.frame, assembled.active, lost)
        return Request(
            k=assembled.tick.k,
            actuator=actuator,
            client=module,
            bid="command" if took.active else "silent",
            values=took.values,
            fault=took.fault,
        )

    return ClientSlice(step, executor.sensors, executor.outside)


def whole_executor(program: Program, clients: ClientList) -> Executor:
    """All clients, and the contracts, of a program.

    Raises:
        Failure: a module in Python cannot be imported or built.
    """
    return ClientListExecutor(program, clients)


class ActivityExecutor:
    """Whether a module in Python is active, and nothing else. Mutable: the module's memory.

    Raises:
        Failure: the module cannot be imported or built.
    """

    def __init__(self, program: Program, module: PythonModule) -> None:
        active = Contract(name=module.name, expression=IsActive(type=BOOL, name=module.name))
        alone = replace(program, modules=(module,), wires=(), limits=(), contracts=(active,), tests=())
        self._executor = ClientListExecutor(alone, ClientList(guards=(), actuators=()))

    def step(self, frame: Frame) -> bool:
        """Whether it has a command in this frame."""
        return not self._executor.step(frame).breaches
