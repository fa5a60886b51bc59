"""What a client executes of a program: a frame in, a request out, and memory as bytes."""

from __future__ import annotations

from colony.execute.compiled import Compiled
from colony.execute.executor import ClientExecutor
from colony.ir.frame import Answer
from colony.runtime.clients.memory import BadMemory, decode_memory, encode_memory
from colony.runtime.frames.assembler import Assembled
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Request


class ClientProgram:
    """Steps one client's view of a program. Mutable: its memory.

    Raises:
        KeyError: there is no such client.
    """

    def __init__(self, compiled: Compiled, actuator: str, module: str) -> None:
        self._executor = ClientExecutor(compiled, actuator, module)
        self._inactive = dict.fromkeys(self._executor.python_modules, Answer())
        self._actuator = actuator
        self._module = module
        self._fresh = True

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors that it reads."""
        return self._executor.sensors

    @property
    def python_modules(self) -> tuple[str, ...]:
        """The modules in Python whose answers it needs; they run in processes of their own."""
        return self._executor.python_modules

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
        took = self._executor.step(assembled.frame, self._inactive | {**assembled.answers}, lost)
        return Request(
            k=assembled.tick.k,
            actuator=self._actuator,
            client=self._module,
            bid=took.bid,
            values=took.values,
            fault=took.fault,
        )
