"""Publishing of frames, common to all servers: they answer ticks with frames, and keep them for a while."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Effect, Fetch, Sample, Send, ServerFrame, Stopped, Tick

Fields = Mapping[str, Sample | None]

MAX_REPUBLISHED_FRAMES = 64
"""Largest number of frames that a server publishes again between two ticks."""

MAX_REPUBLISHED_BYTES = 1 << 20
"""Byte limit (estimated) of the frames that a server publishes again between two ticks."""

FRAMES_KEPT = 2000
"""Number of frames that a server keeps for readers that missed one: two seconds of 1 ms frames."""

KEPT_BYTES = 16 << 20
"""Byte limit (estimated) of the frames that a server keeps; fields that several frames share count once."""

FRAME_BYTES = 100
"""Estimated bytes of a frame without fields."""


class FetchBudget:
    """The budget of frames that a server publishes again between two ticks. Mutable: what is used of it.

    A frame goes to all readers, so one answer is enough; a reader that missed it fetches it again after the
    next tick. Without a limit, a reader that falls behind would be sent more frames than it can read, fall
    further behind, and fetch more.
    """

    def __init__(self) -> None:
        self._answered: set[tuple[str, int]] = set()
        self._bytes = 0

    def renew(self) -> None:
        """Renew the budget at a new tick."""
        self._answered.clear()
        self._bytes = 0

    def take(self, server: str, k: int, size: int) -> bool:
        """Return True if frame `k` may be published again, and charge it to the budget."""
        frame = (server, k)
        if frame in self._answered or len(self._answered) >= MAX_REPUBLISHED_FRAMES:
            return False
        if self._answered and self._bytes + size > MAX_REPUBLISHED_BYTES:
            return False
        self._answered.add(frame)
        self._bytes += size
        return True


class _Kept(NamedTuple):
    frame: ServerFrame
    size: int


class Publisher:
    """The publisher of one frame a tick, of which it keeps the newest `keep`. Mutable: the frames kept.

    It never publishes two different frames for one k. For a tick that it missed, it publishes "no value" for
    all fields on request, so that all readers see the same. It ignores fetches of frames before its first
    one: another process, which died, may have published them.
    """

    def __init__(
        self,
        server: str,
        read: Callable[[Tick], Fields],
        *,
        keep: int = FRAMES_KEPT,
        stopped: Callable[[], Stopped | None] = lambda: None,
    ) -> None:
        """Start with no frames; `stopped` returns the emergency stop that keeps the actuators idle."""
        self._server = server
        self._read = read
        self._stopped = stopped
        self._kept: dict[int, _Kept] = {}
        self._order: deque[int] = deque()
        self._keep = keep
        self._bytes = 0
        self._shared: dict[int, int] = {}  # number of kept frames by the id of their fields object
        self._since: int | None = None
        self._latest = -1
        self._forgotten = -1
        self._budget = FetchBudget()
        self._was_full = False

    @property
    def listens(self) -> tuple[str, ...]:
        """Topics of ticks and of fetches of the server's frames."""
        return (topics.TICKS, topics.fetches(self._server))

    @property
    def reached(self) -> tuple[str, ...]:
        """A sentence for users if frames were dropped early for lack of room; else nothing."""
        if not self._was_full:
            return ()
        kept = f"{len(self._kept)} of {self._keep} are kept"
        return (f"frames: {kept}, because of the limit of {KEPT_BYTES >> 20} MiB",)

    def handle(self, message: Tick | Fetch) -> Iterable[Effect]:
        """Answer a tick with its frame, once, and a fetch with a kept frame, within the budget."""
        if isinstance(message, Tick):
            frame = self._tick(message)
        else:
            frame = self._fetch(message.k)
        return () if frame is None else (Send(topics.frames(self._server), frame),)

    def _tick(self, tick: Tick) -> ServerFrame | None:
        k = tick.k
        if self._since is None:
            self._since, self._forgotten = k, k - 1
        if k > self._latest:
            self._budget.renew()
        if k in self._kept or k <= self._forgotten:
            return None
        return self._store(k, self._read(tick)).frame

    def _fetch(self, k: int) -> ServerFrame | None:
        kept = self._kept.get(k)
        if kept is None and (k >= self._latest or k <= self._forgotten):
            return None
        if not self._budget.take(self._server, k, FRAME_BYTES if kept is None else kept.size):
            return None
        return (kept or self._store(k, _NO_FIELDS)).frame

    def _store(self, k: int, fields: Fields) -> _Kept:
        assert self._since is not None
        frame = ServerFrame(
            server=self._server, k=k, fields=fields, since=self._since, stopped=self._stopped()
        )
        kept = self._kept[k] = _Kept(frame, self._size(fields))
        self._order.append(k)
        self._latest = max(self._latest, k)
        sharing = self._shared[id(fields)] = self._shared.get(id(fields), 0) + 1
        self._bytes += FRAME_BYTES if sharing > 1 else kept.size
        while len(self._order) > self._keep or (self._bytes > KEPT_BYTES and len(self._order) > 1):
            self._was_full |= len(self._order) <= self._keep
            self._forget(self._order.popleft())
        return kept

    def _forget(self, k: int) -> None:
        frame, size = self._kept.pop(k)
        self._forgotten = max(self._forgotten, k)
        shared = id(frame.fields)
        self._shared[shared] -= 1
        if self._shared[shared]:
            size = FRAME_BYTES
        else:
            del self._shared[shared]
        self._bytes -= size

    def _size(self, fields: Fields) -> int:
        newest = self._kept.get(self._latest)
        if newest is not None and newest.frame.fields is fields:
            return newest.size
        return frame_bytes(fields)


def frame_bytes(fields: Fields) -> int:
    """Estimate the bytes of a frame with these fields."""
    return FRAME_BYTES + sum(_sample_bytes(name, sample) for name, sample in fields.items())


def _sample_bytes(name: str, sample: Sample | None) -> int:
    if sample is None:
        return len(name) + 2
    value = sample.value
    return len(name) + 20 + (9 * len(value) if isinstance(value, tuple) else 9)


_NO_FIELDS: Fields = {}
