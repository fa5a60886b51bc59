"""A module in Python as a process: it runs the module, alone, and tells DServer its answer in each frame.

Whatever the module does to its process, it does to no other: its client, other guards and the observer take
its answers from DServer's frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Protocol

from colony.ir.frame import Answer, Frame
from colony.runtime.frames.assembler import FrameAssembler
from colony.runtime.frames.membership import Membership
from colony.runtime.protocol import topics
from colony.runtime.protocol.fields import DSERVER
from colony.runtime.protocol.messages import (
    Announcement,
    Effect,
    Fetch,
    Message,
    QuietNode,
    Send,
    ServerFrame,
    Tick,
)


class Answering(Protocol):
    """Gives the answers of a module, from its initial memory after each `restart`."""

    def step(self, frame: Frame) -> Answer: ...

    def restart(self) -> None: ...


class Announcer(QuietNode):
    """Mutable: the module's memory, what it announced, and frames that are not complete yet.

    It tells the answers of every frame, also of those that it is late for: others wait for them. What it told
    is told again to who asks DServer for it, as DServer may have been started anew. The memory of an object
    in Python cannot be saved: an announcer that takes the place of a dead one, and cannot step through all
    frames since the epoch began, asks for a new one.
    """

    def __init__(
        self, module: str, assembler: FrameAssembler, executor: Answering, *, run: str, keep: int
    ) -> None:
        self.address = topics.activity(DSERVER.name, module)
        self.listens = tuple(dict.fromkeys((*assembler.listens, topics.fetches(DSERVER.name))))
        self._module = module
        self._assembler = assembler
        self._executor = executor
        self._membership = Membership((self.address,), run)
        self._told: dict[int, Announcement] = {}
        self._keep = keep
        self._fresh = True

    def start(self, now_ns: int) -> Iterable[Effect]:
        return self._membership.start(now_ns)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        match message:
            case Tick():
                yield from self._membership.heard(message, now_ns)
                yield from self._assembler.take(message)
                yield from self._announce()
                if self._assembler.lost and message.run == self._membership.run:
                    yield self._membership.begin_anew(self._assembler.start)
            case ServerFrame():
                self._assembler.take(message)
                yield from self._announce()
            case Fetch() if message.server == self.address and message.k in self._told:
                yield Send(topics.announcements(DSERVER.name), self._told[message.k])
            case _:
                return

    def _announce(self) -> Iterator[Effect]:
        for assembled in self._assembler.complete():
            if assembled.restart and not self._fresh:
                self._executor.restart()
            self._fresh = False
            k = assembled.tick.k
            answer = self._executor.step(assembled.frame)
            told = self._told[k] = Announcement(k=k, module=self._module, answer=answer)
            self._told.pop(k - self._keep, None)
            yield Send(topics.announcements(DSERVER.name), told)
