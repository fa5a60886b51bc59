"""The node that runs a module in Python, alone in its process, and sends DServer its answer in each frame.

A fault in the module affects no other process: its client, other guards and the observer take its answers
from DServer's frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Protocol

from colony.ir.frame import Answer, Frame
from colony.ir.servers import DSERVER
from colony.runtime.frames.assembler import FrameAssembler
from colony.runtime.frames.membership import Membership
from colony.runtime.protocol import topics
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
                yield Send(topics.announcements(DSERVER.name), self._announced[message.k])
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
            yield Send(topics.announcements(DSERVER.name), announcement)
