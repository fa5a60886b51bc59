"""The position of one page in a run: it plays, pauses, follows the newest frame, or jumps. No I/O."""

from __future__ import annotations

from colony.watch.marks import Mark
from colony.watch.store import SnapshotStore

MIN_SPEED, MAX_SPEED = 0.05, 100.0
"""Bounds of the speed, in seconds of the run a second."""


class Player:
    """A position in a store. Mutable. Times `now` are in seconds of any monotonic clock."""

    def __init__(self, store: SnapshotStore, *, follows: bool) -> None:
        self._store = store
        self.speed = 1.0
        self.is_following = follows
        self.is_playing = not follows
        self._anchor: tuple[float, float] | None = None  # a clock time, and the time in the run then
        self._index = 0

    def index(self, now: float) -> int | None:
        """Return the frame to show now, None while there is none."""
        span = self._store.span
        if span.first == span.end:
            return None
        if self.is_following:
            self._index = span.end - 1
        elif self.is_playing:
            self._index = self._store.index_at(self._time(now))
            if self._index >= span.end - 1:
                self._anchor = now, self._store.time(span.end - 1)
                self.is_playing = not self._store.is_complete
        self._index = min(max(self._index, span.first), span.end - 1)
        return self._index

    def _time(self, now: float) -> float:
        if self._anchor is None:
            self._anchor = now, self._store.time(self._index)
        began, t = self._anchor
        return t + (now - began) * self.speed

    def play(self, now: float, speed: float) -> None:
        """Play from here, at a speed; from the beginning if this is the end."""
        span = self._store.span
        if self._index >= span.end - 1 and self._store.is_complete:
            self._index = span.first
        self.speed = min(max(speed, MIN_SPEED), MAX_SPEED)
        self._go(now, self._index)
        self.is_playing = True

    def pause(self) -> None:
        """Stay at this frame."""
        self.is_playing = self.is_following = False

    def seek(self, now: float, t: float) -> None:
        """Go to a time in the run."""
        self._go(now, self._store.index_at(t))

    def step(self, now: float, frames: int) -> None:
        """Go some frames forward, or back, and stay there."""
        self.pause()
        span = self._store.span
        self._go(now, min(max(self._index + frames, span.first), max(span.end - 1, 0)))

    def jump(self, now: float, kinds: Mark, *, backward: bool) -> bool:
        """Go to the nearest frame in which one of these begins, and stay there; return False if none does."""
        found = self._store.next_marked(self._index, kinds, backward=backward)
        if found is None:
            return False
        self.pause()
        self._go(now, found)
        return True

    def follow(self) -> None:
        """Follow the newest frame."""
        self.is_following, self.is_playing = True, False

    def _go(self, now: float, index: int) -> None:
        self.is_following = False
        self._index = index
        span = self._store.span
        self._anchor = (now, self._store.time(index)) if span.first < span.end else None
