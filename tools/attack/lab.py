"""The robot that is attacked: `colony serve all` with the simulator and a gateway on loopback, and a witness.

The witness is a process of the robot's own machine: it hears everything that anybody gets through.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import zenoh

from colony.runtime.kit.connection import Session
from colony.runtime.transport.live.network import ZenohSession
from colony.runtime.transport.live.robot_address import Credentials, local
from colony.runtime.transport.live.security import Permission
from tests.cli.machine import MAP, ROBOT, Machine, children_of
from tests.runtime.transport.live.certificates import Authority, free_port
from tests.waiting import until

USERS: Mapping[str, tuple[Permission, ...]] = {
    "ada": ("read", "command"),
    "guard": ("stop",),
    "reader": ("read",),
    "stopper": ("stop",),
    "driver": ("command",),
    "runner": ("run",),
}
"""`ada` and `guard` are honest; each of the others abuses the one right that it has."""

SERVED = ("Clock", "RServer", "PServer", "DServer", "Gateway")
"""The servers of a robot, with its gateway."""

MARK = b"intruder"
"""Beginning of all bytes that an attacker sends, unless they have to be a message."""


class Lab:
    """Mutable: the certificates that were made."""

    def __init__(self, machine: Machine, folder: Path) -> None:
        self.machine = machine
        self.authority = Authority(folder)
        self.port = free_port()
        self.endpoint = f"tls/localhost:{self.port}"
        table = self.authority.table(USERS)
        serves = ("serve", "all", "--robot", ROBOT, "--map", MAP)
        self.robot = machine.start(*serves, "--listen", self.endpoint, "--security", str(table))
        until(lambda: self.robot.ended() or machine.truth(), "the simulator starts")
        assert not self.robot.ended(), self.robot.err
        with self.session("ada") as session:
            until(lambda: {"Clock", "RServer", "DServer"} <= set(session.servers()), "the robot is there")

    def session(self, who: str | Credentials) -> Session:
        """A session through the gateway."""
        credentials = self.authority.user(who) if isinstance(who, str) else who
        return Session.open(ROBOT, gateway=self.endpoint, credentials=credentials)

    def pids(self) -> dict[str, int]:
        """The processes of the robot: by the name that they serve, else by their id."""
        named = {pid: name for name, pid in self.machine.directory.running().items()}
        found = {self.robot.pid, *children_of(self.robot.pid), *named}
        return {named.get(pid, str(pid)): pid for pid in found}

    def pid(self, server: str) -> int:
        """The process of a server, as soon as there is one."""
        return until(lambda: self.machine.pid(server), f"{server} runs") or 0

    def restarted(self, server: str, old: int) -> int:
        """The process of a server, as soon as it is another one."""
        return until(lambda: (pid := self.machine.pid(server)) != old and pid, f"{server} restarts") or 0


@contextmanager
def lab(folder: Path) -> Iterator[Lab]:
    """A robot, until the end of the block."""
    machine = Machine(folder / "m")
    (folder / "m").mkdir()
    try:
        yield Lab(machine, folder)
    finally:
        machine.close()


class Witness:
    """Records what reaches the robot's own machine. Mutable: the keys of attackers' messages, queries and
    tokens."""

    def __init__(self, machine: Machine) -> None:
        self.got: list[tuple[str, str]] = []
        self._network = ZenohSession.open(local(ROBOT, machine.environment))
        session = self._network.session
        session.declare_subscriber("**", zenoh.handlers.Callback(self._put, indirect=False))
        session.declare_queryable("**", zenoh.handlers.Callback(self._query, indirect=False))
        alive = self._network.alive
        until(lambda: set(SERVED) <= set(alive()), "it is linked to all")
        tokens = zenoh.handlers.Callback(self._token, indirect=False)
        session.liveliness().declare_subscriber("**", tokens, history=True)

    def processes(self) -> set[str]:
        """The ids of zenoh of the robot's processes: the witness is linked to all of them."""
        info = self._network.session.info
        return {str(zid) for zid in (*info.routers_zid(), *info.peers_zid())}

    def asks(self) -> None:
        """Send a query to everybody, which a queryable of an attacker would answer."""
        for reply in self._network.session.get("**", timeout=0.2):
            if reply.ok is not None and reply.ok.payload.to_bytes().startswith(MARK):
                self.got.append(("answer", str(reply.ok.key_expr)))

    def _put(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            self.got.append(("delete", str(sample.key_expr)))
        elif sample.payload.to_bytes().startswith(MARK):
            self.got.append(("put", str(sample.key_expr)))

    def _query(self, query: zenoh.Query) -> None:
        with query:
            if query.payload is not None and query.payload.to_bytes().startswith(MARK):
                self.got.append(("query", str(query.key_expr)))

    def _token(self, sample: zenoh.Sample) -> None:
        if MARK.decode() in str(sample.key_expr):
            self.got.append(("token", str(sample.key_expr)))

    def close(self) -> None:
        self._network.close()


def descriptors(pid: int) -> int:
    """Return the number of file descriptors that a process has open."""
    return len(os.listdir(f"/proc/{pid}/fd"))


def memory_mb(pid: int) -> float:
    """Return the resident memory of a process in MB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
