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

One process may serve under several names:

    with Servers.open("Lidar", "Button", robot="rome") as servers:
        servers.mainloop({"Lidar": Offer(fields=[scan]), "Button": Offer(fields=[pressed])})
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from colony.runtime.kit.commands import Command, command, parameter
from colony.runtime.kit.description import Field, FieldReader, field
from colony.runtime.kit.once import Report
from colony.runtime.kit.service import Service, method
from colony.runtime.protocol.calls import Method, RefusedError
from colony.runtime.servers.drivers import Reading
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.network import ZenohSession, local_time
from colony.runtime.transport.live.robot_address import Local, local

__all__ = [
    "Command",
    "Field",
    "Method",
    "Offer",
    "Reading",
    "RefusedError",
    "Server",
    "Servers",
    "command",
    "field",
    "method",
    "parameter",
]


def _to_stderr(problem: str) -> None:
    print(problem, file=sys.stderr, flush=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Offer:
    """What one server offers: methods for its clients, fields of its frames, commands for actuators."""

    methods: Iterable[Method] = ()
    fields: Iterable[Field] = ()
    commands: Iterable[Command] = ()


class Servers:
    """Servers of one process on the robot's own machine, by name. Mutable."""

    def __init__(
        self, names: tuple[str, ...], network: ZenohSession, robot_address: Local, report: Report
    ) -> None:
        """Create the servers of an open session; see `open`."""
        self.names = names
        self._network = network
        self._time = local_time(robot_address)
        self._report = report
        self._host: Host | None = None
        self._ending = False

    @classmethod
    def open(
        cls,
        *names: str,
        robot: str,
        environment: Mapping[str, str] = os.environ,
        report: Report = _to_stderr,
    ) -> Servers:
        """Announce servers, which answer once `mainloop` runs.

        `report` receives each error that the servers survive.

        Raises:
            ValueError: no name is given, or one of them twice.
            AlreadyRunningError: the robot already has a server of one of these names.
            RunDirectoryError: the robot's folder cannot be used.
        """
        if not names or len(set(names)) < len(names):
            raise ValueError(f"found the names {names!r}; expected one or more, each once")
        robot_address = local(robot, environment)
        network = ZenohSession.open(robot_address, server_names=names)
        try:
            return cls(names, network, robot_address, report)
        except BaseException:
            network.close()
            raise

    def mainloop(self, offers: Mapping[str, Offer]) -> None:
        """Serve what each server offers, until `exitloop`.

        The servers handle one message at a time: while a method or field of one runs, the others wait.

        Raises:
            ValueError: `offers` has other names than those that are announced.
        """
        if set(offers) != set(self.names):
            raise ValueError(f"found offers of {', '.join(offers)}; expected {', '.join(self.names)}")
        services = [_service(name, offers[name], self._report) for name in self.names]
        self._host = Host(self._network, services, time=self._time, report=self._report)
        if self._ending:
            self._host.stop()
        self._host.run()

    def exitloop(self) -> None:
        """End `mainloop`, even before it begins; callable from any thread, handler or signal handler."""
        self._ending = True
        if self._host is not None:
            self._host.stop()

    def close(self) -> None:
        """Withdraw the names. Idempotent."""
        self._network.close()

    def __enter__(self) -> Servers:
        """Return the servers."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close the servers."""
        self.close()


def _service(name: str, offer: Offer, report: Report) -> Service:
    fields = FieldReader(name, offer.fields, report)
    return Service(name, offer.methods, fields, report, commands=offer.commands)


class Server:
    """A named server on the robot's own machine, the only one of its process. Mutable."""

    def __init__(self, servers: Servers) -> None:
        """Create the server of an open session; see `open`."""
        [self.name] = servers.names
        self._servers = servers

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
        return cls(Servers.open(name, robot=robot, environment=environment, report=report))

    def mainloop(
        self,
        methods: Iterable[Method] = (),
        *,
        fields: Iterable[Field] = (),
        commands: Iterable[Command] = (),
    ) -> None:
        """Serve, one message at a time, until `exitloop`."""
        self._servers.mainloop({self.name: Offer(methods=methods, fields=fields, commands=commands)})

    def exitloop(self) -> None:
        """End `mainloop`, even before it begins; callable from any thread, handler or signal handler."""
        self._servers.exitloop()

    def close(self) -> None:
        """Withdraw the server's name. Idempotent."""
        self._servers.close()

    def __enter__(self) -> Server:
        """Return the server."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close the server."""
        self.close()
