"""Who lives: whoever was heard of within the lease; and which frames of a server were heard of at all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

LEASE_NS = 250_000_000

VOID_AT_ONCE = 2000
"""Void frames in one tick, so that it stays a small message."""


def lease(frame_ns: int) -> int:
    """A quarter of a second, but at least three frames."""
    return max(LEASE_NS, 3 * frame_ns)


class Liveness:
    """Remembers when each of `names` was heard of last. Mutable: those times."""

    def __init__(self, names: Iterable[str], *, lease_ns: int, now_ns: int) -> None:
        self._heard: dict[str, int | None] = dict.fromkeys(names, now_ns)
        self._lease_ns = lease_ns

    def heard(self, name: str, now_ns: int) -> None:
        """A sign of life; of a stranger it is ignored."""
        if name in self._heard:
            self._heard[name] = now_ns

    def gone(self, name: str) -> None:
        """Count one as missing from now on, until it is heard of."""
        if name in self._heard:
            self._heard[name] = None

    def slept(self, asleep_ns: int) -> None:
        """The listener itself was not there for a time, in which nobody's silence means anything."""
        for name, at in self._heard.items():
            if at is not None:
                self._heard[name] = at + asleep_ns

    def missing(self, now_ns: int) -> tuple[str, ...]:
        """Those not heard of for longer than the lease, in the order in which they were named."""
        lease_ns = self._lease_ns
        return tuple([n for n, at in self._heard.items() if at is None or now_ns - at > lease_ns])


class TickAnswers:
    """What servers answered to ticks, so that all readers can be told the same of a server that died.

    A frame of a server that lives is waited for, and asked for again: it will come. One of a server that died
    (it is silent for the lease, or was started anew) and that nobody heard of will never come: it is void.
    Mutable: the frames that are waited for.
    """

    def __init__(self, servers: Iterable[str], *, keep: int) -> None:
        self._waiting: dict[str, dict[int, None]] = {server: {} for server in servers}
        self._void: list[tuple[str, int]] = []
        self._keep = keep

    def asked(self, k: int, down: Iterable[str]) -> None:
        """Tick `k` went out; who is down is not waited for."""
        for server, waiting in self._waiting.items():
            if server not in down:
                waiting[k] = None
                if len(waiting) > self._keep:
                    del waiting[next(iter(waiting))]

    def answered(self, server: str, k: int, since: int) -> None:
        """A frame came, of a server that knows of frames from `since` on."""
        waiting = self._waiting.get(server)
        if waiting is None:
            return
        waiting.pop(k, None)
        if waiting and next(iter(waiting)) < since:
            self._give_up(server, [k for k in waiting if k < since])

    def void(self, down: Iterable[str]) -> tuple[tuple[str, int], ...]:
        """Return frames that have become void, now that these servers are down: at most `VOID_AT_ONCE`, the
        others at the next call.
        """
        for server in down:
            self._give_up(server, list(self._waiting.get(server, ())))
        void, self._void = tuple(self._void[:VOID_AT_ONCE]), self._void[VOID_AT_ONCE:]
        return void

    def overdue(self, tick: int) -> Iterator[tuple[str, int]]:
        """Yield servers and frames to fetch with this tick, the newest frames first: those that are 2, 4,
        8... ticks old, so that a server gets no more fetches the further it is behind.
        """
        for server, waiting in self._waiting.items():
            age = 2
            while waiting and age <= self._keep:
                if tick - age in waiting:
                    yield server, tick - age
                age *= 2

    def forget(self) -> None:
        """No frame of the past is of use any more."""
        for waiting in self._waiting.values():
            waiting.clear()
        self._void.clear()

    def _give_up(self, server: str, frames: list[int]) -> None:
        waiting = self._waiting.get(server, {})
        for k in frames:
            del waiting[k]
            self._void.append((server, k))
