"""Servers of your own, in addition to those that every robot has (thesis section 4.5.3).

    class Charge(msgspec.Struct):
        amperes: float

    battery = Battery()
    with Server.open("Battery", robot="rome") as server:
        signal.signal(signal.SIGTERM, lambda *_: server.exitloop())
        server.mainloop(
            [method("charge", Charge, lambda caller, arguments: battery.charge(arguments.amperes))],
            fields=[
                field("level", battery.level, meaning="charge level, 0 to 1"),
                field("cells", battery.cells, unit="V", size=4, has_age=True),
            ],
        )

Clients make the call `Ask("charge", Charge(2.0), None, "command")`; a behavior reads `from Battery.level`.
`battery.cells` returns a `Reading(value, age_ns)`, so a behavior may read it `within 1 s` (`fields.py`).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping

from colony.runtime.kit.fields import Field, Reading, Report, field
from colony.runtime.kit.service import Service, method
from colony.runtime.protocol.calls import Method, RefusedError
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.network import ZenohSession, local_time
from colony.runtime.transport.live.robot_address import Local, local

__all__ = ["Field", "Method", "Reading", "RefusedError", "Server", "field", "method"]


def _to_stderr(problem: str) -> None:
    print(problem, file=sys.stderr, flush=True)


class Server:
    """A named server on the robot's own machine. Mutable."""

    def __init__(self, name: str, network: ZenohSession, robot_address: Local, report: Report) -> None:
        """Create the server of an open session; see `open`."""
        self.name = name
        self._network = network
        self._time = local_time(robot_address)
        self._report = report
        self._host: Host | None = None
        self._ending = False

    @classmethod
    def open(
        cls,
        name: str,
        *,
        robot: str,
        environment: Mapping[str, str] = os.environ,
        report: Report = _to_stderr,
    ) -> Server:
        """Announce a server, which answers once `mainloop` runs.

        `report` receives each error that the server survives.

        Raises:
            AlreadyRunningError: the robot already has a server of this name.
            RunDirectoryError: the robot's folder cannot be used.
        """
        robot_address = local(robot, environment)
        network = ZenohSession.open(robot_address, server_names=(name,))
        try:
            return cls(name, network, robot_address, report)
        except BaseException:
            network.close()
            raise

    def mainloop(self, methods: Iterable[Method], *, fields: Iterable[Field] = ()) -> None:
        """Serve, one call at a time, until `exitloop`."""
        service = Service(self.name, methods, fields, self._report)
        self._host = Host(self._network, [service], time=self._time, report=self._report)
        if self._ending:
            self._host.stop()
        self._host.run()

    def exitloop(self) -> None:
        """End `mainloop`, even before it begins; callable from any thread, handler or signal handler."""
        self._ending = True
        if self._host is not None:
            self._host.stop()

    def close(self) -> None:
        """Withdraw the server's name. Idempotent."""
        self._network.close()

    def __enter__(self) -> Server:
        """Return the server."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close the server."""
        self.close()
