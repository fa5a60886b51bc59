"""The leader's connections, which deploy the program to the Clock and to every participating server.

A restarted server gets the program again. The run ends when these connections do. Each server has its own
thread here, so that a missing server does not delay the others.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from contextlib import ExitStack

from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import CallRefusedError, RobotConnectionError, ServerNotFoundError
from colony.runtime.library.clock import deploy
from colony.runtime.protocol.deployment import Deployment

PAUSE_S = 0.05
"""Seconds between two attempts to reach a server."""

REFUSED_PAUSE_S = 0.5
"""Seconds between two attempts to deploy to a server that is in another run, whose leader may have died."""

BUSY_TIMEOUT_S = 3.0
"""Seconds that a server may be in another run before this run fails; longer than a lease."""


class ProgramDeployer:
    """Deploys a program to its servers. Stateful: knows which servers accepted it, and the first refusal.

    Args:
        session: session of this process with the robot; the deployer does not close it.
        deployment: program to run.
        servers: names of the servers.
        report: callback for a sentence about each server that it waits for; called from other threads.
    """

    def __init__(
        self, session: Session, deployment: Deployment, servers: Iterable[str], report: Callable[[str], None]
    ) -> None:
        self._session = session
        self._deployment = deployment
        self._report = report
        self._stop = threading.Event()
        self._accepting_servers: set[str] = set()
        self.refusal: str | None = None
        self._threads = [
            threading.Thread(
                target=self._keep_deployed, args=(server,), name=f"deploys to {server}", daemon=True
            )
            for server in servers
        ]
        for thread in self._threads:
            thread.start()

    @property
    def accepting_servers(self) -> frozenset[str]:
        """The servers that accepted the program."""
        return frozenset(self._accepting_servers)

    def close(self) -> None:
        """End the run. Idempotent."""
        self._stop.set()
        for thread in self._threads:
            thread.join()

    # --- one server ----------------------------------------------------------------------------------

    def _keep_deployed(self, server: str) -> None:
        with ExitStack() as resources:
            connection = self._connect(server)
            if connection is None:
                return
            resources.enter_context(connection)
            if self._deploy(server, connection):
                self._accepting_servers.add(server)
                self._stop.wait()

    def _connect(self, server: str) -> Connection | None:
        """Wait for the server, and return a connection; None if it refuses or the run ends."""
        name = f"run of {self._deployment.program}"
        reported = False
        while not self._stop.is_set():
            try:
                return self._session.connect(server, name=name)
            except ServerNotFoundError as problem:
                if not reported:
                    self._report(f"waiting: {problem}")
                    reported = True
            except CallRefusedError as problem:
                self._note_refusal(server, problem)
                return None
            except RobotConnectionError:
                pass
            self._stop.wait(PAUSE_S)
        return None

    def _deploy(self, server: str, connection: Connection) -> bool:
        """Deploy now and after every restart of the server; return True if it accepted the program."""
        waited_s = 0.0
        while not self._stop.is_set():
            try:
                connection.keep(deploy(self._deployment))
                return True
            except CallRefusedError as problem:
                if problem.code != "busy" or waited_s >= BUSY_TIMEOUT_S:
                    self._note_refusal(server, problem)
                    return False
                self._stop.wait(REFUSED_PAUSE_S)
                waited_s += REFUSED_PAUSE_S
            except RobotConnectionError:
                self._stop.wait(PAUSE_S)
        return False

    def _note_refusal(self, server: str, problem: CallRefusedError) -> None:
        self.refusal = self.refusal or f"{server}: {problem.message}"
