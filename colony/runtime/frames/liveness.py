"""Liveness: leases of servers and clients, and the frames with which servers answered ticks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

MIN_LEASE_NS = 250_000_000
"""Shortest lease of a server or client, in nanoseconds."""

MAX_VOID_PER_TICK = 2000
"""Largest number of void frames in one tick, so that it stays a small message."""


def lease(frame_ns: int) -> int:
    """Return the lease in nanoseconds: a quarter of a second, but at least three frames."""
    return max(MIN_LEASE_NS, 3 * frame_ns)


class Liveness:
    """The leases of `names`. Mutable: the time at which each was last heard from."""

    def __init__(self, names: Iterable[str], *, lease_ns: int, now_ns: int) -> None:
        self._heard: dict[str, int | None] = dict.fromkeys(names, now_ns)
        self._lease_ns = lease_ns

    def renew(self, name: str, now_ns: int) -> None:
        """Renew the lease of a name that was heard from; ignore an unknown name."""
        if name in self._heard:
            self._heard[name] = now_ns

    def mark_missing(self, name: str) -> None:
        """Mark a name as missing until it is heard from."""
        if name in self._heard:
            self._heard[name] = None

    def extend(self, suspended_ns: int) -> None:
        """Extend all leases by the time for which this process was suspended and heard from no one."""
        for name, at in self._heard.items():
            if at is not None:
                self._heard[name] = at + suspended_ns

    def missing(self, now_ns: int) -> tuple[str, ...]:
        """Return the names not heard from for longer than the lease, in the order given."""
        lease_ns = self._lease_ns
        return tuple([n for n, at in self._heard.items() if at is None or now_ns - at > lease_ns])


class TickAnswers:
    """The servers' answers to ticks, so that all readers agree on the frames of a server that died.

    A frame of a live server is waited for and fetched again. A server is dead if it is silent for the lease,
    or was restarted; those of its frames that have not arrived are void. Mutable: the frames that are waited
    for.
    """

    def __init__(self, servers: Iterable[str], *, keep: int) -> None:
        self._waiting: dict[str, dict[int, None]] = {server: {} for server in servers}
        self._void: list[tuple[str, int]] = []
        self._keep = keep

    def tick_sent(self, k: int, down: Iterable[str]) -> None:
        """Wait for the frame `k` of all servers but those that are down."""
        for server, waiting in self._waiting.items():
            if server not in down:
                waiting[k] = None
                if len(waiting) > self._keep:
                    del waiting[next(iter(waiting))]

    def frame_received(self, server: str, k: int, since: int) -> None:
        """Record frame `k` of a server whose first frame was `since`; earlier ones become void."""
        waiting = self._waiting.get(server)
        if waiting is None:
            return
        waiting.pop(k, None)
        if waiting and next(iter(waiting)) < since:
            self._give_up(server, [k for k in waiting if k < since])

    def void(self, down: Iterable[str]) -> tuple[tuple[str, int], ...]:
        """Return frames that have become void, now that these servers are down.

        At most `MAX_VOID_PER_TICK` are returned; the next call returns the others.
        """
        for server in down:
            self._give_up(server, list(self._waiting.get(server, ())))
        void, self._void = tuple(self._void[:MAX_VOID_PER_TICK]), self._void[MAX_VOID_PER_TICK:]
        return void

    def overdue(self, tick: int) -> Iterator[tuple[str, int]]:
        """Yield servers and frames to fetch with this tick, the newest frames first.

        They are 2, 4, 8... ticks old, so that a server that is further behind does not get more fetches.
        """
        for server, waiting in self._waiting.items():
            age = 2
            while waiting and age <= self._keep:
                if tick - age in waiting:
                    yield server, tick - age
                age *= 2

    def clear(self) -> None:
        """Drop all past frames: a new epoch does not need them."""
        for waiting in self._waiting.values():
            waiting.clear()
        self._void.clear()

    def _give_up(self, server: str, frames: list[int]) -> None:
        waiting = self._waiting.get(server, {})
        for k in frames:
            del waiting[k]
            self._void.append((server, k))
