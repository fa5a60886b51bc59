"""The clients of a run as the Clock sees them: who is ready, who lives, whose requests come in time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from colony.runtime.frames.liveness import Liveness
from colony.runtime.library.clock import ClientWho
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Verdict


@dataclass(frozen=False, slots=True)
class _Member:
    ready: bool = False
    on_time: int = 0
    late: int = 0


class ClientRegistry:
    """Mutable: all of it.

    `clients` (by address) send a request a frame, and say that they do; `others` only have to be ready for a
    run to begin.
    """

    def __init__(
        self, clients: Iterable[str], others: Iterable[str] = (), *, lease_ns: int, now_ns: int
    ) -> None:
        self._clients = {client: _Member() for client in clients}
        self._others = {other: _Member() for other in others}
        self._liveness = Liveness(self._clients, lease_ns=lease_ns, now_ns=now_ns)

    def __contains__(self, address: str) -> bool:
        return address in self._clients or address in self._others

    @property
    def complete(self) -> bool:
        """Whether all are ready."""
        return all(m.ready for group in (self._clients, self._others) for m in group.values())

    def ready(self, address: str) -> None:
        """One says that it is ready; of a stranger it is ignored."""
        member = self._clients.get(address) or self._others.get(address)
        if member is not None:
            member.ready = True

    def begin(self, now_ns: int) -> None:
        """The run begins: who is not ready does not live."""
        for client, member in self._clients.items():
            if member.ready:
                self._liveness.heard(client, now_ns)
            else:
                self._liveness.gone(client)

    def heard(self, client: str, now_ns: int) -> None:
        """One sends requests, and so lives; of a stranger it is ignored."""
        self._liveness.heard(client, now_ns)

    def judged(self, verdict: Verdict) -> None:
        """Count whose request was there in time, and whose was not."""
        for name, fate in verdict.fates:
            member = self._clients.get(topics.client_address(verdict.actuator, name))
            if member is not None:
                member.on_time += fate not in ("late", "lost")
                member.late += fate == "late"

    def slept(self, asleep_ns: int) -> None:
        """See `Liveness.slept`."""
        self._liveness.slept(asleep_ns)

    def lost(self, now_ns: int) -> tuple[str, ...]:
        """The clients that do not live."""
        return self._liveness.missing(now_ns)

    def who(self, now_ns: int) -> tuple[ClientWho, ...]:
        """All that is known of them."""
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
