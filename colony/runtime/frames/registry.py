"""Registry of a run's clients, kept by the Clock: ready, alive, and on time with their requests."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from colony.runtime.frames.liveness import Liveness
from colony.runtime.library.clock import ClientWho
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import UNHEARD, Verdict


@dataclass(frozen=False, slots=True)
class _Member:
    ready: bool = False
    on_time: int = 0
    late: int = 0


class ClientRegistry:
    """The members of a run: their readiness, their leases, and how many requests were on time. Mutable.

    Args:
        clients: addresses of the clients, each of which sends a request a frame.
        others: addresses of members that only have to be ready for a run to begin.
        lease_ns: nanoseconds without a request after which a client is lost.
        now_ns: the present time.
    """

    def __init__(
        self, clients: Iterable[str], others: Iterable[str] = (), *, lease_ns: int, now_ns: int
    ) -> None:
        self._clients = {client: _Member() for client in clients}
        self._others = {other: _Member() for other in others}
        self._liveness = Liveness(self._clients, lease_ns=lease_ns, now_ns=now_ns)

    def __contains__(self, address: str) -> bool:
        """Return True if an address is that of a member."""
        return address in self._clients or address in self._others

    @property
    def complete(self) -> bool:
        """True if all members are ready."""
        return all(m.ready for group in (self._clients, self._others) for m in group.values())

    def ready(self, address: str) -> None:
        """Mark a member as ready; ignore an address that is no member."""
        member = self._clients.get(address) or self._others.get(address)
        if member is not None:
            member.ready = True

    def begin(self, now_ns: int) -> None:
        """Begin the run: clients that are not ready are marked lost."""
        for client, member in self._clients.items():
            if member.ready:
                self._liveness.heard(client, now_ns)
            else:
                self._liveness.gone(client)

    def heard(self, client: str, now_ns: int) -> None:
        """Renew the lease of a client that sent a request; ignore an address that is no client."""
        self._liveness.heard(client, now_ns)

    def judged(self, verdict: Verdict, now_ns: int) -> None:
        """Count requests that were on time or late; those that counted renew the lease of their client.

        A request that was refused was on time, but renews no lease.
        """
        for name, fate in verdict.fates:
            client = topics.client_address(verdict.actuator, name)
            member = self._clients.get(client)
            if member is not None:
                if fate not in UNHEARD:
                    self._liveness.heard(client, now_ns)
                member.on_time += fate not in ("late", "lost")
                member.late += fate == "late"

    def slept(self, asleep_ns: int) -> None:
        """Extend all leases by the time that this process was suspended, as `Liveness.slept` does."""
        self._liveness.slept(asleep_ns)

    def lost(self, now_ns: int) -> tuple[str, ...]:
        """Return the clients that are lost."""
        return self._liveness.missing(now_ns)

    def who(self, now_ns: int) -> tuple[ClientWho, ...]:
        """Return the state of each client."""
        lost = self.lost(now_ns)
        return tuple(
            ClientWho(
                client=client,
                ready=member.ready,
                lives=client not in lost,
                on_time=member.on_time,
                late=member.late,
            )
            for client, member in self._clients.items()
        )
