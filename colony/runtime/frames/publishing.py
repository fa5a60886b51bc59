"""Publishing of frames, which all servers share: they answer ticks with frames, and keep them for a while."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Effect, Fetch, Sample, SendMessage, ServerFrame, Stopped, Tick

Fields = Mapping[str, Sample | None]

MAX_REPUBLISHED_FRAMES = 64
"""Maximum number of frames that a server republishes between two ticks."""

MAX_REPUBLISHED_BYTES = 1 << 20
"""Byte limit (estimated) of the frames that a server republishes between two ticks."""

FRAMES_KEPT = 2000
"""Number of frames kept for readers that missed one: two seconds of 1 ms frames."""

KEPT_BYTES = 16 << 20
"""Byte limit (estimated) of the frames that a server keeps; fields shared by several frames count once."""

FRAME_BYTES = 100
"""Estimated bytes of a frame without fields."""


class FetchBudget:
    """The limit on the frames that a server republishes between two ticks. Mutable.

    A frame goes to all readers, so it is republished once; a reader that misses it again fetches it after
    the next tick. Without a limit, a reader that falls behind would be sent more frames than it can read,
    fall further behind, and fetch more.
    """

    def __init__(self) -> None:
        self._answered: set[tuple[str, int]] = set()
        self._bytes = 0

    def reset(self) -> None:
        """Restore the full budget, at a new tick."""
        self._answered.clear()
        self._bytes = 0

    def take(self, server: str, k: int, size: int) -> bool:
        """Return True if frame `k` may be republished, and charge it to the budget."""
        frame = (server, k)
        if frame in self._answered or len(self._answered) >= MAX_REPUBLISHED_FRAMES:
            return False
        if self._answered and self._bytes + size > MAX_REPUBLISHED_BYTES:
            return False
        self._answered.add(frame)
        self._bytes += size
        return True


class _KeptFrame(NamedTuple):
    frame: ServerFrame
    size: int


class Publisher:
    """Publishes one frame per tick, and keeps the newest `frames_kept` frames. Mutable.

    It never publishes two different frames for one k. If a reader fetches the frame of a tick that the server
    missed, all fields have "no value", so that all readers see the same frame. Fetches of frames before its
    first one are ignored: a predecessor that died may have published them.
    """

    def __init__(
        self,
        server: str,
        read: Callable[[Tick], Fields],
        *,
        frames_kept: int = FRAMES_KEPT,
        stopped: Callable[[], Stopped | None] = lambda: None,
    ) -> None:
        """Start with no frames; `stopped` returns the emergency stop that keeps the actuators idle."""
        self._server = server
        self._read = read
        self._stopped = stopped
        self._kept: dict[int, _KeptFrame] = {}
        self._order: deque[int] = deque()
        self._frames_kept = frames_kept
        self._bytes = 0
        self._shared: dict[int, int] = {}  # number of kept frames that share a fields object, by its id
        self._since: int | None = None
        self._latest = -1
        self._last_dropped = -1
        self._budget = FetchBudget()
        self._was_full = False

    @property
    def listens(self) -> tuple[str, ...]:
        """Topics of ticks and of fetches of the server's frames."""
        return (topics.TICKS, topics.fetches(self._server))

    @property
    def limit_messages(self) -> tuple[str, ...]:
        """A sentence for users if the byte limit has dropped frames early; else nothing."""
        if not self._was_full:
            return ()
        kept = f"{len(self._kept)} of {self._frames_kept} are kept"
        return (f"frames: {kept}, because of the limit of {KEPT_BYTES >> 20} MiB",)

    def handle(self, message: Tick | Fetch) -> Iterable[Effect]:
        """Answer a tick with its frame, once, and a fetch with a kept frame, within the budget."""
        if isinstance(message, Tick):
            frame = self._tick(message)
        else:
            frame = self._fetch(message.k)
        return () if frame is None else (SendMessage(topics.frames(self._server), frame),)

    def _tick(self, tick: Tick) -> ServerFrame | None:
        k = tick.k
        if self._since is None:
            self._since, self._last_dropped = k, k - 1
        if k > self._latest:
            self._budget.reset()
        if k in self._kept or k <= self._last_dropped:
            return None
        return self._store(k, self._read(tick)).frame

    def _fetch(self, k: int) -> ServerFrame | None:
        kept = self._kept.get(k)
        if kept is None and (k >= self._latest or k <= self._last_dropped):
            return None
        if not self._budget.take(self._server, k, FRAME_BYTES if kept is None else kept.size):
            return None
        return (kept or self._store(k, _NO_FIELDS)).frame

    def _store(self, k: int, fields: Fields) -> _KeptFrame:
        assert self._since is not None
        frame = ServerFrame(
            server=self._server, k=k, fields=fields, since=self._since, stopped=self._stopped()
        )
        kept = self._kept[k] = _KeptFrame(frame, self._size(fields))
        self._order.append(k)
        self._latest = max(self._latest, k)
        uses = self._shared[id(fields)] = self._shared.get(id(fields), 0) + 1
        self._bytes += FRAME_BYTES if uses > 1 else kept.size
        while len(self._order) > self._frames_kept or (self._bytes > KEPT_BYTES and len(self._order) > 1):
            self._was_full |= len(self._order) <= self._frames_kept
            self._drop(self._order.popleft())
        return kept

    def _drop(self, k: int) -> None:
        frame, size = self._kept.pop(k)
        self._last_dropped = max(self._last_dropped, k)
        fields_id = id(frame.fields)
        self._shared[fields_id] -= 1
        if self._shared[fields_id]:
            size = FRAME_BYTES
        else:
            del self._shared[fields_id]
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
