"""Clients: each is one module for one actuator (thesis section 4.8.2).

Clients that read the same servers may share a node, which assembles their frames once. The node steps their
part of the program over every frame, and each client sends its actuator's server one request a frame: a
command, or the reason why it has none. Clients do not communicate with each other. A node that is behind
steps through the frames that it missed, and its clients send requests only for the current frame.

The memory of the node goes to DServer every half second of the robot's time, as one checkpoint per client: a
memory cell that several clients need is in the checkpoint of the first. A process that replaces a dead one
steps through all frames since the epoch began, if they are still available; otherwise it asks DServer for the
checkpoints and steps through the frames since. All checkpoints must exist and be of the same frame;
otherwise the node asks the Clock for a new epoch.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Protocol

import msgspec

from colony.execute.compiled import Compiled
from colony.execute.executor import ClientMemory, ClientsExecutor
from colony.execute.needs import ClientKey
from colony.ir.frame import Answer, Frame
from colony.ir.servers import DSERVER
from colony.runtime.frames.assembler import AssembledFrame, FrameAssembler, Membership
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import (
    Announcement,
    Bounds,
    Checkpoint,
    Effect,
    Fetch,
    Message,
    QuietNode,
    Recall,
    Request,
    SendMessage,
    ServerFrame,
    Tick,
)
from colony.runtime.protocol.topics import client_address, module_of

# --- announcer -----------------------------------------------------------------------------------------
#
# The node that runs a module in Python, alone in its process, and sends DServer its answer in each frame.
#
# A fault in the module affects no other process: its client, other guards and the observer take its answers
# from DServer's frames.


class AnnouncingExecutor(Protocol):
    """An executor of one module in Python."""

    def step(self, frame: Frame) -> Answer:
        """Return the module's answer in a frame."""
        ...

    def restart(self) -> None:
        """Reset the module to its initial memory."""
        ...


class Announcer(QuietNode):
    """The node of a module in Python. Stateful: keeps its memory, its announcements, and incomplete frames.

    It announces the answer of every frame, even when it is late, because other nodes wait for it. It repeats
    an announcement that DServer, which may have been restarted, no longer has. The memory of a Python object
    cannot be saved: an announcer that replaces a dead one, and cannot step through all frames since the epoch
    began, requests a new epoch.
    """

    def __init__(
        self,
        module: str,
        assembler: FrameAssembler,
        executor: AnnouncingExecutor,
        *,
        run: str,
        frames_kept: int,
    ) -> None:
        self.address = topics.activity(DSERVER.name, module)
        self.listens = (*assembler.listens, topics.repeats(DSERVER.name, module))
        self._module = module
        self._assembler = assembler
        self._executor = executor
        self._membership = Membership((self.address,), run, assembler)
        self._announced: dict[int, Announcement] = {}
        self._frames_kept = frames_kept
        self._memory_is_initial = True

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Report the module as ready."""
        return self._membership.start(now_ns)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Step over the frames that are complete, announce the answers, and repeat them on request."""
        match message:
            case Tick():
                yield from self._membership.on_tick(message, now_ns)
                yield from self._assembler.take(message)
                yield from self._announce()
                if self._assembler.lost and message.run == self._membership.run:
                    yield self._membership.restart_request(self._assembler.start)
            case ServerFrame():
                self._assembler.take(message)
                yield from self._announce()
            case Fetch() if message.server == self.address and message.k in self._announced:
                yield SendMessage(topics.announcements(DSERVER.name), self._announced[message.k])
            case _:
                return

    def _announce(self) -> Iterator[Effect]:
        for assembled in self._assembler.pop_complete():
            if assembled.restart and not self._memory_is_initial:
                self._executor.restart()
            self._memory_is_initial = False
            k = assembled.tick.k
            answer = self._executor.step(assembled.frame)
            announcement = self._announced[k] = Announcement(k=k, module=self._module, answer=answer)
            if len(self._announced) > self._frames_kept:
                del self._announced[next(iter(self._announced))]
            yield SendMessage(topics.announcements(DSERVER.name), announcement)


# --- memory --------------------------------------------------------------------------------------------
#
# Encoding of a client's memory for checkpoints: msgpack, checked on decoding.


class MemoryFormatError(ValueError):
    """Bytes that are not a client's memory; the text says what is wrong with them."""


class _Memory(msgspec.Struct, frozen=True, array_like=True):
    first_ns: int | None
    cells: dict[str, float | bool | int]


_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(_Memory)


def encode_memory(memory: ClientMemory) -> bytes:
    """Return the memory of a client in msgpack."""
    return _encoder.encode(_Memory(memory.first_ns, memory.cells))


def decode_memory(data: bytes) -> ClientMemory:
    """Return the memory encoded in these bytes.

    Raises:
        MemoryFormatError: the bytes are not a client's memory.
    """
    try:
        memory = _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as problem:
        raise MemoryFormatError(str(problem) or type(problem).__name__) from None
    return ClientMemory(memory.first_ns, memory.cells)


# --- client program ------------------------------------------------------------------------------------
#
# The part of a program that the clients of one node execute: a frame in, one message per client out.


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


# --- client --------------------------------------------------------------------------------------------


CHECKPOINT_NS = 500_000_000
"""Nanoseconds of the robot's time between two checkpoints."""

RECALL_NS = 1_000_000_000
"""Nanoseconds after which a node stops asking DServer for its checkpoints."""


class ClientNode(QuietNode):
    """The clients of one process that read the same servers and modules in Python.

    Stateful: keeps their memory, and incomplete frames.

    Args:
        program: program of the clients. The node has the first client's address.
        servers: servers to which the requests of each client go, in the order of `program.clients`.
        assembler: assembler of all frames that the clients read.
        run: run in which the clients take part.
    """

    def __init__(
        self,
        program: ClientProgram,
        servers: Iterable[str],
        assembler: FrameAssembler,
        *,
        run: str,
    ) -> None:
        self.program = program
        self.address = program.clients[0]
        self.listens = (
            *assembler.listens,
            *(topics.recall_answers(DSERVER.name, c) for c in program.clients),
        )
        self._requests = tuple(map(topics.requests, servers))
        self._assembler = assembler
        self._membership = Membership(program.clients, run, assembler)
        self._begin()

    def _begin(self) -> None:
        self._epoch = self._assembler.start
        self._caught_up = False
        self._recalling_since: int | None = None
        self._recalled: dict[str, Checkpoint] = {}
        self._saved_ns: int | None = None

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Report the clients as ready."""
        return self._membership.start(now_ns)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Step over the frames that are complete, and recover memory if frames are lost."""
        match message:
            case Tick():
                yield from self._membership.on_tick(message, now_ns)
                yield from self._assembler.take(message)
                if self._assembler.start != self._epoch:
                    self._begin()
                yield from self._advance(now_ns)
                if self._assembler.lost and message.run == self._membership.run:
                    yield from self._recover(now_ns)
            case ServerFrame():
                self._assembler.take(message)
                yield from self._advance(now_ns)
            case Checkpoint():
                yield from self._take_checkpoint(message, now_ns)
            case _:
                return

    @property
    def frontier(self) -> tuple[int, int]:
        """The current epoch, and the last frame that the clients stepped over."""
        return self._assembler.start, self._assembler.last

    def _advance(self, now_ns: int) -> Iterator[Effect]:
        for assembled in self._assembler.pop_complete():
            requests = self.program.step(assembled)
            if assembled.current:
                self._caught_up = True
                yield from map(SendMessage, self._requests, requests)
                yield from self._membership.on_requests_sent(assembled.tick.k, now_ns)
                yield from self._save(assembled)

    # --- memory ----------------------------------------------------------------------------------------

    def _save(self, assembled: AssembledFrame) -> Iterator[Effect]:
        tick = assembled.tick
        if self._saved_ns is None:
            self._saved_ns = tick.t_ns
        if tick.t_ns - self._saved_ns >= CHECKPOINT_NS:
            self._saved_ns = tick.t_ns
            for client in self.program.clients:
                memory = self.program.memory(client)
                saved = Checkpoint(client=client, k=tick.k, start=tick.start, memory=memory)
                yield SendMessage(topics.checkpoints(DSERVER.name), saved)

    def _recover(self, now_ns: int) -> Iterator[Effect]:
        """Recall the memory from DServer, because the next frame is unobtainable, or request a new epoch."""
        missing = [client for client in self.program.clients if client not in self._recalled]
        if self._recalling_since is None:
            self._recalling_since = now_ns
        asking = now_ns - self._recalling_since <= RECALL_NS
        if asking and not self._caught_up and missing:
            for client in missing:
                yield SendMessage(topics.checkpoints(DSERVER.name), Recall(client=client))
        else:
            yield self._membership.restart_request(self._assembler.start)

    def _take_checkpoint(self, saved: Checkpoint, now_ns: int) -> Iterator[Effect]:
        """Take a recalled checkpoint, and resume once those of all clients are here.

        If they are not all of one frame from which the node can continue, the node requests a new epoch with
        the next tick.
        """
        expected = saved.client in self.program.clients and saved.client not in self._recalled
        if self._caught_up or self._recalling_since is None or not expected:
            return  # an answer to an earlier or a repeated recall
        self._recalled[saved.client] = saved
        if len(self._recalled) < len(self.program.clients):
            return
        assembler = self._assembler
        frames = {(recalled.start, recalled.k) for recalled in self._recalled.values()}
        is_reachable = saved.start == assembler.start and assembler.next <= saved.k <= assembler.latest
        memories = {client: recalled.memory for client, recalled in self._recalled.items()}
        if len(frames) == 1 and is_reachable and self.program.recall(memories):
            yield from self._assembler.resume(saved.k)
            yield from self._advance(now_ns)
