"""The part of a program that the clients of one node execute: a frame in, one message per client out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from colony.execute.compiled import Compiled
from colony.execute.executor import ClientsExecutor
from colony.execute.needs import ClientKey
from colony.ir.frame import Answer
from colony.runtime.clients.memory import MemoryFormatError, decode_memory, encode_memory
from colony.runtime.frames.assembler import AssembledFrame
from colony.runtime.protocol.messages import Bounds, Request
from colony.runtime.protocol.topics import client_address, module_of


class ClientProgram:
    """The program of a node's clients. Stateful: holds their memory.

    `keys` are the clients; those of bounds come last.

    Raises:
        KeyError: there is no such client.
    """

    def __init__(self, compiled: Compiled, clients: Iterable[ClientKey]) -> None:
        self._executor = ClientsExecutor(compiled, clients)
        self.keys = self._executor.keys
        self._by_address = {client_address(*key): key for key in self.keys}
        self._default_answers = dict.fromkeys(self._executor.python_modules, Answer(blind=True))
        self._memory_is_initial = True

    @property
    def clients(self) -> tuple[str, ...]:
        """The addresses of the clients."""
        return tuple(self._by_address)

    @property
    def sensors(self) -> tuple[str, ...]:
        """The sensors that the clients read."""
        return self._executor.sensors

    @property
    def python_modules(self) -> tuple[str, ...]:
        """The modules in Python whose answers the clients need; these run in their own processes."""
        return self._executor.python_modules

    def memory(self, client: str) -> bytes:
        """Return the memory cells that belong to a client, by address (`ClientsExecutor.memory`)."""
        return encode_memory(self._executor.memory(self._by_address[client]))

    def recall(self, memories: Mapping[str, bytes]) -> bool:
        """Restore the memory of every client, all as of the same frame.

        Return False, and change nothing, if `memories` do not fit these clients.
        """
        try:
            self._executor.recall({self._by_address[c]: decode_memory(data) for c, data in memories.items()})
        except (MemoryFormatError, ValueError):
            return False
        self._memory_is_initial = False
        return True

    def step(self, assembled: AssembledFrame) -> tuple[Request | Bounds, ...]:
        """Return the request or bounds of each client in a frame, in the order of `clients`.

        Frames must be consecutive; an epoch begins with initial memory.
        """
        if assembled.restart and not self._memory_is_initial:
            self._executor.restart()
        self._memory_is_initial = False
        lost = frozenset(map(module_of, assembled.tick.lost)) if assembled.tick.lost else _NO_MODULES
        steps = self._executor.step(assembled.frame, self._default_answers | {**assembled.answers}, lost)
        k = assembled.tick.k
        requests = [
            Request(
                k=k,
                actuator=actuator,
                client=module,
                bid=step.bid,
                values=step.values,
                fault=step.fault,
            )
            for (actuator, module), step in zip(self._executor.clients, steps, strict=True)
        ]
        if not self._executor.bounded:
            return tuple(requests)
        bounds = zip(self._executor.bounded, self._executor.bounds(), strict=True)
        return (*requests, *[Bounds(k=k, actuator=actuator, **step._asdict()) for actuator, step in bounds])


_NO_MODULES: frozenset[str] = frozenset()
