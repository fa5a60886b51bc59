"""The Clock's registry of a run's clients: readiness, leases, and counts of requests on time and late."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from colony.execute.needs import BOUNDS
from colony.runtime.frames.liveness import Liveness
from colony.runtime.library.clock import ClientParticipant
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import UNHEARD, Verdict


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
