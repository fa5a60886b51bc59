"""What all servers have in common: they answer ticks with frames, and keep these for who missed one."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping

from colony.runtime import topics
from colony.runtime.messages import Effect, Fetch, Sample, Send, ServerFrame, Tick

Fields = Mapping[str, Sample | None]


class Publisher:
    """Publishes one frame a tick and keeps the newest `keep` of them. Mutable: the frames kept.

    For one k it never publishes two different frames. Asked for a frame of a tick that it never saw, it says
    "no value" for all fields, so that every reader goes on with the same.
    """

    def __init__(self, server: str, read: Callable[[Tick], Fields], *, keep: int) -> None:
        self._server = server
        self._read = read
        self._kept: dict[int, ServerFrame] = {}
        self._order: deque[int] = deque()
        self._keep = keep
        self._latest = -1
        self._forgotten = -1

    @property
    def listens(self) -> tuple[str, ...]:
        return (topics.TICKS, topics.fetches(self._server))

    def handle(self, message: Tick | Fetch) -> Iterable[Effect]:
        """Answer a tick with its frame, once, and a fetch with the frame kept."""
        k = message.k
        frame = self._kept.get(k)
        if isinstance(message, Tick):
            if frame is not None or k <= self._forgotten:
                return ()
            frame = self._store(ServerFrame(server=self._server, k=k, fields=self._read(message)))
        elif frame is None:
            if k >= self._latest or k <= self._forgotten:
                return ()
            frame = self._store(ServerFrame(server=self._server, k=k, fields={}))
        return (Send(topics.frames(self._server), frame),)

    def _store(self, frame: ServerFrame) -> ServerFrame:
        self._kept[frame.k] = frame
        self._order.append(frame.k)
        self._latest = max(self._latest, frame.k)
        if len(self._order) > self._keep:
            old = self._order.popleft()
            del self._kept[old]
            self._forgotten = max(self._forgotten, old)
        return frame
