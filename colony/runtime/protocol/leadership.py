"""Leadership of a run at a server: no other run is deployed while its leader is connected.

A resident run yields: it is deployed while no other leader is connected, until another one deploys.
"""

from __future__ import annotations

from colony.runtime.protocol.calls import RefusedError
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import Deployment, problems


class Leadership:
    """The run deployed to a server, and its leader. Mutable."""

    def __init__(self, server: str) -> None:
        self._server = server
        self._run: str | None = None
        self._resident = False
        self._leader: Caller | None = None

    @property
    def leader(self) -> Caller | None:
        """The leader of the deployed run, None if it is not connected."""
        return self._leader

    @property
    def is_orphaned(self) -> bool:
        """True if the leader of the deployed run is lost; False if no leader has deployed one."""
        return self._run is not None and self._leader is None

    def take(self, caller: Caller, deployed: Deployment) -> bool:
        """Make a caller the leader; return True if its run is new, False if it is deployed already.

        Raises:
            RefusedError: "busy" while the leader of another run is connected; "arguments" for an invalid
                deployment.
        """
        leader = None if self._resident and not deployed.resident else self._leader
        if leader is not None and deployed.run != self._run and leader.connection != caller.connection:
            text = f"{self._server} is in the run `{self._run}`, which {leader.name} leads"
            raise RefusedError("busy", text)
        wrong = problems(deployed)
        if wrong:
            raise RefusedError("arguments", f"{self._server}.deploy: {'; '.join(wrong)}")
        self._leader = caller
        new = deployed.run != self._run
        self._run, self._resident = deployed.run, deployed.resident
        return new

    def on_lost(self, caller: Caller) -> bool:
        """Handle the end of a connection; return True if it was the leader's.

        Its deployment remains until another leader deploys.
        """
        is_lost = self._leader is not None and self._leader.connection == caller.connection
        if is_lost:
            self._leader = None
        return is_lost
