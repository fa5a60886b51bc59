"""The Clock's registry of a run's clients: readiness, leases, and counts of requests on time and late."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from colony.execute.needs import BOUNDS
from colony.runtime.library.clock import ClientParticipant
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import UNHEARD, Progress, Tick, Verdict

# --- liveness ------------------------------------------------------------------------------------------
#
# Liveness: leases of servers and clients, and the frames with which servers answered ticks.


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


# --- resumption ----------------------------------------------------------------------------------------
#
# Resumption of a run by a restarted Clock, or after the leader was away: its epoch goes on.
#
# The Clock learns the epoch from the progress that clients and the observer report (`Ready.progress`). The
# run goes on after the last frame that any of them stepped over. Ticks after that frame are abandoned: no
# memory depends on them, but the numbers up to them are used up. Nodes that are behind get the reported
# ticks from the new Clock, and the frames from the servers.


class ResumedEpoch(NamedTuple):
    """The epoch in which a run goes on after the frame `last`.

    `ticks` are known ticks up to that frame, in order. Frames of `behind` were not stepped over by all nodes.
    `used_k` is the highest number in use, and `void` the void frames listed only in abandoned ticks.
    """

    start: int
    last: Tick
    ticks: tuple[Tick, ...]
    behind: tuple[Tick, ...]
    used_k: int
    void: tuple[tuple[str, int], ...]


class Resumption:
    """The progress of the nodes of one run, as far as they have reported it. Mutable."""

    def __init__(self, run: str) -> None:
        self.run = run
        self._reports: dict[str, Progress] = {}

    @property
    def has_begun(self) -> bool:
        """True if the run began before, as far as is known."""
        return bool(self._reports)

    def take(self, address: str, progress: Progress | None) -> None:
        """Take a node's report; a later one replaces it."""
        if progress is not None:
            self._reports[address] = progress

    def epoch(self) -> ResumedEpoch | None:
        """Return the epoch that goes on.

        Return None if the run has not begun, if no node stepped over a frame of the newest epoch, or if the
        tick of the last of these frames is unknown.
        """
        start = max((report.start for report in self._reports.values()), default=-1)
        current = [report for report in self._reports.values() if report.start == start]
        ticks = {tick.k: tick for report in current for tick in report.ticks if tick.start == start}
        last_k = max((report.stepped for report in current), default=-1)
        last = ticks.get(last_k)
        if last is None:
            return None
        known = tuple(ticks[k] for k in sorted(ticks) if k <= last_k)
        least_k = min(r.stepped if r.start == start else start - 1 for r in self._reports.values())
        return ResumedEpoch(
            start=start,
            last=last,
            ticks=known,
            behind=tuple(tick for tick in known if tick.k > least_k),
            used_k=max(ticks),
            void=tuple(dict.fromkeys(v for k in sorted(ticks) if k > last_k for v in ticks[k].void)),
        )


# --- registry ------------------------------------------------------------------------------------------


@dataclass(frozen=False, slots=True)
class _Member:
    ready: bool = False
    on_time: int = 0
    late: int = 0


class ClientRegistry:
    """The members of a run, with their readiness, leases, and counts of requests. Mutable.

    Args:
        clients: addresses of the clients, each of which sends one request per frame.
        announcers: addresses of the members that run modules in Python; they need only report ready.
        lease_ns: nanoseconds without a request after which a client is lost.
        now_ns: current time.
    """

    def __init__(
        self, clients: Iterable[str], announcers: Iterable[str] = (), *, lease_ns: int, now_ns: int
    ) -> None:
        self._clients = {client: _Member() for client in clients}
        self._announcers = {announcer: _Member() for announcer in announcers}
        self._liveness = Liveness(self._clients, lease_ns=lease_ns, now_ns=now_ns)

    def __contains__(self, address: str) -> bool:
        """Return True if the address belongs to a member."""
        return address in self._clients or address in self._announcers

    @property
    def all_ready(self) -> bool:
        """True if all members are ready."""
        return all(m.ready for group in (self._clients, self._announcers) for m in group.values())

    def mark_ready(self, address: str) -> None:
        """Mark a member as ready; ignore other addresses."""
        member = self._clients.get(address) or self._announcers.get(address)
        if member is not None:
            member.ready = True

    def begin(self, now_ns: int) -> None:
        """Begin the run; clients that are not ready are lost."""
        for client, member in self._clients.items():
            if member.ready:
                self._liveness.renew(client, now_ns)
            else:
                self._liveness.mark_missing(client)

    def renew(self, client: str, now_ns: int) -> None:
        """Renew the lease of a client that sent a request; ignore other addresses."""
        self._liveness.renew(client, now_ns)

    def record_verdict(self, verdict: Verdict, now_ns: int) -> None:
        """Count the requests that were on time or late, and renew the leases of their clients.

        A refused request counts as on time, but renews no lease. So do bounds that no command waited for.
        """
        bounds = self._clients.get(topics.client_address(verdict.actuator, BOUNDS))
        if bounds is not None and all(name != BOUNDS for name, _ in verdict.fates):
            bounds.on_time += 1
        for name, fate in verdict.fates:
            client = topics.client_address(verdict.actuator, name)
            member = self._clients.get(client)
            if member is not None:
                if fate not in UNHEARD:
                    self._liveness.renew(client, now_ns)
                member.on_time += fate not in ("late", "lost")
                member.late += fate == "late"

    def extend(self, suspended_ns: int) -> None:
        """Extend all leases by the time for which this process was suspended."""
        self._liveness.extend(suspended_ns)

    def lost(self, now_ns: int) -> tuple[str, ...]:
        """Return the clients that are lost."""
        return self._liveness.missing(now_ns)

    def statuses(self, now_ns: int) -> tuple[ClientParticipant, ...]:
        """Return the state of each client."""
        lost = self.lost(now_ns)
        return tuple(
            ClientParticipant(
                client=client,
                ready=member.ready,
                lives=client not in lost,
                on_time=member.on_time,
                late=member.late,
            )
            for client, member in self._clients.items()
        )
