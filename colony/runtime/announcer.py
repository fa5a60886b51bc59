"""A module in Python as a process whose activity other clients' guards need: it tells DServer each frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from colony.ir.frame import Frame
from colony.runtime import topics
from colony.runtime.assembly import FrameAssembler
from colony.runtime.fields import DSERVER
from colony.runtime.messages import Announcement, Effect, Message, Send, ServerFrame, Tick


class Announcer:
    """Mutable: the module's memory, and frames that are not complete yet.

    It tells the activity of every frame, also of those that it is late for: others wait for it.
    """

    def __init__(self, module: str, assembler: FrameAssembler, active: Callable[[Frame], bool]) -> None:
        self.address = topics.activity(DSERVER.name, module)
        self.listens = assembler.listens
        self._module = module
        self._assembler = assembler
        self._active = active

    def start(self, now_ns: int) -> Iterable[Effect]:
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        if not isinstance(message, (Tick, ServerFrame)):
            return
        yield from self._assembler.take(message)
        for tick, frame, _, _ in self._assembler.complete():
            told = Announcement(k=tick.k, module=self._module, active=self._active(frame))
            yield Send(topics.announcements(DSERVER.name), told)

    def close(self) -> None:
        """It holds nothing outside this process."""
