"""The leader's connections: they deploy the program at the Clock and at every participating server.

A server that restarts gets the program again. The run ends with these connections. Each server has a thread
of its own here, so that a missing server does not hold up the others.
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
"""Seconds before asking a server in another run again, whose leader may be about to be given up."""

BUSY_S = 3.0
"""Seconds that a server may be in another run before this one is given up; longer than a lease."""


class Leading:
    """The deployment of a program at its servers. Mutable: the servers that took it, and any refusal.

    Args:
        session: the process's session with the robot; stays open.
        deployment: the program to run.
        servers: the names of the servers.
        report: takes a sentence on each awaited server, from other threads.
    """

    def __init__(
        self, session: Session, deployment: Deployment, servers: Iterable[str], report: Callable[[str], None]
    ) -> None:
        self._session = session
        self._deployment = deployment
        self._report = report
        self._stop = threading.Event()
        self._deployed: set[str] = set()
        self.refused: str | None = None
        self._threads = [
            threading.Thread(target=self._lead, args=(server,), name=f"leads {server}", daemon=True)
            for server in servers
        ]
        for thread in self._threads:
            thread.start()

    @property
    def deployed(self) -> frozenset[str]:
        """The servers that took the program."""
        return frozenset(self._deployed)

    def close(self) -> None:
        """End the run. Idempotent."""
        self._stop.set()
        for thread in self._threads:
            thread.join()

    # --- one server ----------------------------------------------------------------------------------

    def _lead(self, server: str) -> None:
        with ExitStack() as holds:
            connection = self._connected(server)
            if connection is None:
                return
            holds.enter_context(connection)
            if self._deploy(server, connection):
                self._deployed.add(server)
                self._stop.wait()

    def _connected(self, server: str) -> Connection | None:
        """Return a connection as soon as the server is up; None if it refuses or the run ends."""
        name = f"run of {self._deployment.program}"
        told = False
        while not self._stop.is_set():
            try:
                return self._session.connect(server, name=name)
            except ServerNotFoundError as problem:
                if not told:
                    self._report(f"waiting: {problem}")
                    told = True
            except CallRefusedError as problem:
                self._give_up(server, problem)
                return None
            except RobotConnectionError:
                pass
            self._stop.wait(PAUSE_S)
        return None

    def _deploy(self, server: str, connection: Connection) -> bool:
        """Deploy now and whenever the server comes back; return True if the server took the program."""
        waited_s = 0.0
        while not self._stop.is_set():
            try:
                connection.keep(deploy(self._deployment))
                return True
            except CallRefusedError as problem:
                if problem.code != "busy" or waited_s >= BUSY_S:
                    self._give_up(server, problem)
                    return False
                self._stop.wait(REFUSED_PAUSE_S)
                waited_s += REFUSED_PAUSE_S
            except RobotConnectionError:
                self._stop.wait(PAUSE_S)
        return False

    def _give_up(self, server: str, problem: CallRefusedError) -> None:
        self.refused = self.refused or f"{server}: {problem.message}"
