"""A client: one module for one actuator, a process of its own (thesis section 4.8.2).

It puts its frames together from what the servers publish, steps its slice of the program over every one of
them, and sends its actuator's server one request a frame: a command, or that it has none. It talks to
nobody else. A client that is behind steps through the frames that it missed, and speaks again at the
present one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from colony.runtime import topics
from colony.runtime.assembly import Assembled, FrameAssembler
from colony.runtime.messages import Effect, Message, Request, Send, ServerFrame, Tick

Slice = Callable[[Assembled], Request]
"""A client's part of the program: what it wants in a frame."""


class ClientNode:
    """Mutable: the memory of its slice, and frames that are not complete yet."""

    def __init__(
        self, *, actuator: str, module: str, server: str, assembler: FrameAssembler, step: Slice
    ) -> None:
        self.address = topics.client_address(actuator, module)
        self.listens = assembler.listens
        self._requests = topics.requests(server)
        self._assembler = assembler
        self._step = step

    def start(self, now_ns: int) -> Iterable[Effect]:
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        if not isinstance(message, (Tick, ServerFrame)):
            return
        yield from self._assembler.take(message)
        for assembled in self._assembler.complete():
            request = self._step(assembled)
            if assembled.current:
                yield Send(self._requests, request)

    def close(self) -> None:
        """It holds nothing outside this process."""
