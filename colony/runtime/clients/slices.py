"""The compiled program in the shapes in which the processes of the runtime execute it."""

from __future__ import annotations

from colony.execute.compiled import Compiled
from colony.execute.executor import ClientExecutor
from colony.runtime.clients.memory import BadMemory, decode_memory, encode_memory
from colony.runtime.frames.assembly import Assembled
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Request


class ClientSlice:
    """The part of a program that one client executes. Mutable: its memory.

    Raises:
        KeyError: there is no such client.
        Failure: its module in Python cannot be imported or built; `step` may, too, where an epoch begins.
    """

    def __init__(self, compiled: Compiled, actuator: str, module: str) -> None:
        self._executor = ClientExecutor(compiled, actuator, module)
        self._actuator = actuator
        self._module = module
        self._fresh = True

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors that it reads."""
        return self._executor.sensors

    @property
    def outside(self) -> tuple[str, ...]:
        """The modules in Python, of other processes, whose activity it needs."""
        return self._executor.outside

    @property
    def portable(self) -> bool:
        """Whether another process can go on from `memory`: nothing of it is an object in Python."""
        return self._executor.portable

    @property
    def memory(self) -> bytes:
        """All that it remembers."""
        return encode_memory(self._executor.memory)

    def recall(self, memory: bytes) -> bool:
        """Go on from there; False, and nothing changed, if that is not the memory of this client."""
        try:
            self._executor.memory = decode_memory(memory)
        except (BadMemory, ValueError):
            return False
        self._fresh = False
        return True

    def step(self, assembled: Assembled) -> Request:
        """What the client wants in a frame. Frames must follow each other; an epoch begins with no memory."""
        if assembled.restart and not self._fresh:
            self._executor.restart()
        self._fresh = False
        lost = frozenset(map(topics.module_of, assembled.tick.lost))
        took = self._executor.step(assembled.frame, assembled.active, lost)
        return Request(
            k=assembled.tick.k,
            actuator=self._actuator,
            client=self._module,
            bid=took.bid,
            values=took.values,
            fault=took.fault,
        )
