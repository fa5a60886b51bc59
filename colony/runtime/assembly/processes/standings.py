"""The leader's knowledge of its run, for queries: clients on time, late or lost, and who drives."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from colony.runtime.library.leader import LEADER, ClientStanding, RunStatus, Standing
from colony.runtime.observe.observer import FrameLog
from colony.runtime.protocol.calls import Asked, CallDesk, Nothing, method
from colony.runtime.protocol.deployment import Deployment, client_addresses
from colony.runtime.protocol.messages import Effect, Message, QuietNode
from colony.runtime.protocol.topics import client_address


@dataclass(frozen=False, slots=True, kw_only=True)
class _Client:
    standing: Standing = "starting"
    fates: Counter[Standing] = field(default_factory=Counter)
    restarts: int = 0
    last_error: str | None = None


class Standings:
    """A sink that counts, for every client, the frames in which it was on time. Mutable: the counts."""

    def __init__(self, deployed: Deployment, *, file: str) -> None:
        self._deployed = deployed
        self._file = file
        self._clients = {address: _Client() for address, _ in client_addresses(deployed)}
        self._commanded_by: dict[str, str | None] = {}
        self._k = -1
        self._frames = 0
        self._restarts = 0
        self._disagreements = 0
        self._pids: Callable[[], Mapping[str, int]] = dict

    def watch(self, pids: Callable[[], Mapping[str, int]]) -> None:
        """Use `pids` to list the live processes of the run; it may be called in any thread."""
        self._pids = pids

    def take(self, log: FrameLog) -> None:
        """Count the fates of the clients in a frame."""
        self._frames += 1
        self._k = log.tick.k
        self._restarts += log.restart
        self._disagreements += bool(log.disagreements)
        for actuator, verdict in log.verdicts.items():
            self._commanded_by[actuator] = verdict.by
            for module, fate in verdict.fates:
                client = self._clients.get(client_address(actuator, module))
                if client is not None:
                    client.standing = "late" if fate == "late" else "lost" if fate == "lost" else "alive"
                    client.fates[client.standing] += 1

    def close(self) -> None:
        """Do nothing: the counts stay."""

    @property
    def frames(self) -> int:
        """The number of frames that were decided."""
        return self._frames

    def died(self, clients: Iterable[str], said: str, *, again: bool) -> None:
        """Record that the process of these clients died.

        Args:
            clients: the addresses of the clients.
            said: the last words of the process.
            again: True if it is restarted.
        """
        for address in clients:
            client = self._clients[address]
            client.restarts += again
            client.last_error = said

    def status(self) -> RunStatus:
        """Return the state of the run."""
        return RunStatus(
            run=self._deployed.run,
            program=self._deployed.program,
            file=self._file,
            process=os.getpid(),
            k=self._k,
            frames=self._frames,
            restarts=self._restarts,
            disagreements=self._disagreements,
            commanded_by=dict(self._commanded_by),
            processes=dict(self._pids()),
            clients=tuple(
                ClientStanding(
                    address=address,
                    standing=c.standing,
                    on_time=c.fates["alive"],
                    late=c.fates["late"],
                    lost=c.fates["lost"],
                    restarts=c.restarts,
                    last_error=c.last_error,
                )
                for address, c in self._clients.items()
            ),
        )


class LeaderServer(QuietNode):
    """A server that answers `run` with the standings. Mutable: its connections."""

    address = LEADER

    def __init__(self, standings: Standings) -> None:
        self._standings = standings
        self._desk = CallDesk(LEADER, (method("run", Nothing, self._run, right="read"),))
        self.listens = self._desk.listens

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Answer a call."""
        return self._desk.handle(message, now_ns)

    def _run(self, asked: Asked, arguments: object, now_ns: int) -> RunStatus:
        return self._standings.status()
