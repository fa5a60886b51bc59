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

from collections.abc import Iterable, Iterator

from colony.ir.servers import DSERVER
from colony.runtime.clients.client_program import ClientProgram
from colony.runtime.frames.assembler import AssembledFrame, FrameAssembler
from colony.runtime.frames.membership import Membership
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import (
    Checkpoint,
    Effect,
    Message,
    QuietNode,
    Recall,
    Send,
    ServerFrame,
    Tick,
)

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
                yield from map(Send, self._requests, requests)
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
                yield Send(topics.checkpoints(DSERVER.name), saved)

    def _recover(self, now_ns: int) -> Iterator[Effect]:
        """Recall the memory from DServer, because the next frame is unobtainable, or request a new epoch."""
        missing = [client for client in self.program.clients if client not in self._recalled]
        if self._recalling_since is None:
            self._recalling_since = now_ns
        asking = now_ns - self._recalling_since <= RECALL_NS
        if asking and not self._caught_up and missing:
            for client in missing:
                yield Send(topics.checkpoints(DSERVER.name), Recall(client=client))
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
