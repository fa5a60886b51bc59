"""A client: one module for one actuator, a process of its own (thesis section 4.8.2).

It puts its frames together from what the servers publish, steps its view of the program over every one of
them, and sends its actuator's server one request a frame: a command, or why it has none. It talks to no other
client. A client that is behind steps through the frames that it missed, and speaks again at the present one.

Its memory goes to DServer every half second of the robot's time. A process that takes the place of a dead one
steps through all frames since the epoch began, where they are still to be had; otherwise it asks DServer for
the memory and steps through those since. When neither can be done, it asks the Clock for a new epoch.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from colony.runtime.clients.client_program import ClientProgram
from colony.runtime.frames.assembler import Assembled, FrameAssembler
from colony.runtime.frames.membership import Membership
from colony.runtime.protocol import topics
from colony.runtime.protocol.fields import DSERVER
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
"""Of the robot's time, between two checkpoints."""

RECALL_NS = 1_000_000_000
"""For how long DServer is asked for a checkpoint, once a frame, before the client does without."""


class ClientNode(QuietNode):
    """Mutable: the memory of its view, and frames that are not complete yet."""

    def __init__(
        self,
        *,
        actuator: str,
        module: str,
        server: str,
        assembler: FrameAssembler,
        part: ClientProgram,
        run: str,
    ) -> None:
        self.address = topics.client_address(actuator, module)
        self.listens = (*assembler.listens, topics.recalled(DSERVER.name, self.address))
        self._requests = topics.requests(server)
        self._assembler = assembler
        self.part = part
        self._membership = Membership(self.address, run)
        self._begin()

    def _begin(self) -> None:
        self._epoch = self._assembler.start
        self._caught_up = False
        self._recalling_since: int | None = None
        self._nothing_to_recall = False
        self._saved_ns: int | None = None

    def start(self, now_ns: int) -> Iterable[Effect]:
        return self._membership.start(now_ns)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        match message:
            case Tick():
                yield from self._membership.heard(message, now_ns)
                yield from self._assembler.take(message)
                if self._assembler.start != self._epoch:
                    self._begin()
                yield from self._go_on(now_ns)
                if self._assembler.lost and message.run == self._membership.run:
                    yield from self._recover(now_ns)
            case ServerFrame():
                self._assembler.take(message)
                yield from self._go_on(now_ns)
            case Checkpoint():
                yield from self._recalled(message, now_ns)
            case _:
                return

    @property
    def frontier(self) -> tuple[int, int]:
        """The epoch that it is in, and the last frame that its memory has seen."""
        return self._assembler.start, self._assembler.next - 1

    def _go_on(self, now_ns: int) -> Iterator[Effect]:
        for assembled in self._assembler.complete():
            request = self.part.step(assembled)
            if assembled.current:
                self._caught_up = True
                yield Send(self._requests, request)
                yield from self._membership.requested(request.k, now_ns)
                yield from self._save(assembled)

    # --- memory ----------------------------------------------------------------------------------------

    def _save(self, assembled: Assembled) -> Iterator[Effect]:
        tick = assembled.tick
        if self._saved_ns is None:
            self._saved_ns = tick.t_ns
        if tick.t_ns - self._saved_ns >= CHECKPOINT_NS:
            self._saved_ns = tick.t_ns
            saved = Checkpoint(client=self.address, k=tick.k, start=tick.start, memory=self.part.memory)
            yield Send(topics.checkpoints(DSERVER.name), saved)

    def _recover(self, now_ns: int) -> Iterator[Effect]:
        """The frame that comes next cannot be had: memory must come from DServer, or begin anew."""
        if self._recalling_since is None:
            self._recalling_since = now_ns
        asking = now_ns - self._recalling_since <= RECALL_NS
        if asking and not self._caught_up and not self._nothing_to_recall:
            yield Send(topics.checkpoints(DSERVER.name), Recall(client=self.address))
        else:
            yield self._membership.begin_anew(self._assembler.start)

    def _recalled(self, saved: Checkpoint, now_ns: int) -> Iterator[Effect]:
        if self._caught_up or self._recalling_since is None or self._nothing_to_recall:
            return  # it was asked for twice
        self._nothing_to_recall = True
        assembler = self._assembler
        newer = saved.start == assembler.start and assembler.next <= saved.k <= assembler.latest
        if newer and self.part.recall(saved.memory):
            yield from self._assembler.resume(saved.k + 1)
            yield from self._go_on(now_ns)
