"""Liveness: leases of servers and clients, and the frames with which servers answered ticks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from colony.runtime.protocol.messages import Tick

MIN_LEASE_NS = 250_000_000
"""Shortest lease of a server or client, in nanoseconds."""

MAX_VOID_PER_TICK = 2000
"""Maximum number of void frames listed in one tick, so that it stays a small message."""


def lease(frame_ns: int) -> int:
    """Return the lease in nanoseconds: a quarter of a second, but at least three frames."""
    return max(MIN_LEASE_NS, 3 * frame_ns)


class Liveness:
    """The leases of `names` (servers or clients). Stateful: remembers when each was last heard from."""

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
        """Extend all leases by the time for which this process was suspended and heard nothing."""
        for name, heard_ns in self._heard.items():
            if heard_ns is not None:
                self._heard[name] = heard_ns + suspended_ns

    def missing(self, now_ns: int) -> tuple[str, ...]:
        """Return the names not heard from for longer than the lease, in their original order."""
        lease_ns = self._lease_ns
        return tuple(
            [n for n, heard_ns in self._heard.items() if heard_ns is None or now_ns - heard_ns > lease_ns]
        )


class TickAnswers:
    """The servers' answers to ticks, so that all readers agree on the frames of a server that died.

    A missing frame of a live server is fetched again. When a server's lease expires, or the server restarts,
    its frames that have not arrived become void. Stateful: remembers the missing frames.
    """

    def __init__(self, servers: Iterable[str], *, frames_kept: int) -> None:
        self._missing: dict[str, dict[int, None]] = {server: {} for server in servers}
        self._resumed: set[int] = set()
        self._void: list[tuple[str, int]] = []
        self._frames_kept = frames_kept

    def tick_sent(self, k: int, down: Iterable[str]) -> None:
        """Expect the frame `k` of all servers but those that are down."""
        for server, missing in self._missing.items():
            if server not in down:
                missing[k] = None
                if len(missing) > self._frames_kept:
                    del missing[next(iter(missing))]

    def frame_received(self, server: str, k: int, since: int) -> None:
        """Record frame `k` of a server whose first frame is `since`; missing ones before that become void."""
        missing = self._missing.get(server)
        if missing is None:
            return
        missing.pop(k, None)
        if missing and next(iter(missing)) < since:
            self._mark_void(server, [k for k in missing if k < since])

    def resume(self, ticks: Iterable[Tick], void: Iterable[tuple[str, int]]) -> None:
        """Expect the answers to ticks of the previous Clock, and declare the frames `void` again."""
        for tick in ticks:
            self._resumed.add(tick.k)
            self.tick_sent(tick.k, tick.down)
        self._void.extend(void)

    def take_void(self, down: Iterable[str]) -> tuple[tuple[str, int], ...]:
        """Return and remove the frames that have become void, now that these servers are down.

        At most `MAX_VOID_PER_TICK` are returned; the next call returns the others.
        """
        for server in down:
            self._mark_void(server, list(self._missing.get(server, ())))
        void, self._void = tuple(self._void[:MAX_VOID_PER_TICK]), self._void[MAX_VOID_PER_TICK:]
        return void

    def overdue(self, k: int) -> Iterator[tuple[str, int]]:
        """Yield the servers and frames to fetch again with tick `k`, the newest frames first.

        Only frames that are 2, 4, 8... ticks old are fetched, so that a server that is far behind is not
        flooded. Frames of the previous Clock are fetched with each tick.
        """
        for server, missing in self._missing.items():
            for resumed in self._resumed.intersection(missing) if self._resumed else ():
                yield server, resumed
            age = 2
            while missing and age <= self._frames_kept:
                if k - age in missing:
                    yield server, k - age
                age *= 2

    def clear(self) -> None:
        """Forget all missing and void frames: a new epoch does not need them."""
        for missing in self._missing.values():
            missing.clear()
        self._resumed.clear()
        self._void.clear()

    def _mark_void(self, server: str, frames: list[int]) -> None:
        missing = self._missing.get(server, {})
        for k in frames:
            del missing[k]
            self._void.append((server, k))
