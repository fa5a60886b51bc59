"""What all servers have in common: they answer ticks with frames, and keep these for who missed one."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping

from colony.runtime import topics
from colony.runtime.messages import Effect, Fetch, Sample, Send, ServerFrame, Stopped, Tick

Fields = Mapping[str, Sample | None]


class Publisher:
    """Publishes one frame a tick and keeps the newest `keep` of them. Mutable: the frames kept.

    For one k it never publishes two different frames. Asked for a frame of a tick that it never saw, it says
    "no value" for all fields, so that every reader goes on with the same. Of frames before the first that it
    answered it says nothing at all: another process, which died, may have published them.
    """

    def __init__(
        self,
        server: str,
        read: Callable[[Tick], Fields],
        *,
        keep: int,
        stopped: Callable[[], Stopped | None] = lambda: None,
    ) -> None:
        """`stopped` gives the emergency stop that keeps the server's actuators idle."""
        self._server = server
        self._read = read
        self._stopped = stopped
        self._kept: dict[int, ServerFrame] = {}
        self._order: deque[int] = deque()
        self._keep = keep
        self._since: int | None = None
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
            if self._since is None:
                self._since, self._forgotten = k, k - 1
            if frame is not None or k <= self._forgotten:
                return ()
            frame = self._store(k, self._read(message))
        elif frame is None:
            if k >= self._latest or k <= self._forgotten:
                return ()
            frame = self._store(k, {})
        return (Send(topics.frames(self._server), frame),)

    def _store(self, k: int, fields: Fields) -> ServerFrame:
        assert self._since is not None
        frame = ServerFrame(
            server=self._server, k=k, fields=fields, since=self._since, stopped=self._stopped()
        )
        self._kept[k] = frame
        self._order.append(k)
        self._latest = max(self._latest, k)
        if len(self._order) > self._keep:
            old = self._order.popleft()
            del self._kept[old]
            self._forgotten = max(self._forgotten, old)
        return frame
