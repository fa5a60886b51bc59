"""The network sockets of processes, as the system shows them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

_TABLES = ("tcp", "tcp6", "udp", "udp6", "raw", "raw6")


class Socket(NamedTuple):
    """A network socket of a process. `local` and `remote` are ports, 0 if there is none."""

    process: str
    protocol: str
    local: int
    remote: int


def network_sockets(processes: Mapping[str, int]) -> Iterator[Socket]:
    """Yield the network sockets of these processes, in every state."""
    table = dict(_table())
    for name, pid in processes.items():
        for inode in _inodes(pid):
            if inode in table:
                protocol, local, remote = table[inode]
                yield Socket(name, protocol, local, remote)


def _table() -> Iterator[tuple[str, tuple[str, int, int]]]:
    for protocol in _TABLES:
        path = Path(f"/proc/net/{protocol}")
        if not path.exists():  # a system without this protocol
            continue
        for line in path.read_text().splitlines()[1:]:
            fields = line.split()
            local, remote = (int(address.rpartition(":")[2], 16) for address in fields[1:3])
            yield fields[9], (protocol, local, remote)


def _inodes(pid: int) -> Iterator[str]:
    try:
        entries = os.listdir(f"/proc/{pid}/fd")
    except FileNotFoundError:  # it just ended
        return
    for entry in entries:
        try:
            target = os.readlink(f"/proc/{pid}/fd/{entry}")
        except FileNotFoundError:
            continue
        if target.startswith("socket:["):
            yield target[len("socket:[") : -1]


def beyond_the_gateway(processes: Mapping[str, int], port: int) -> list[Socket]:
    """Return the sockets that no process of a robot may have: all but the gateway's at its port."""
    found = network_sockets(processes)
    return [
        s for s in found if not (s.process == "Gateway" and s.protocol.startswith("tcp") and s.local == port)
    ]
