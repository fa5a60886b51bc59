"""The user at the other end of a connection on this machine, as the kernel's table of sockets says."""

from __future__ import annotations

import socket
import sys
from collections.abc import Container, Mapping
from pathlib import Path

_TABLE = Path("/proc/net/tcp")
_LOCAL, _REMOTE, _UID = 1, 2, 7  # columns
_ROOT = 0


def own_users(environment: Mapping[str, str], user: int) -> frozenset[int]:
    """Return the numbers of the users whose connections a process of a user accepts.

    These are the user, root, and of root in `sudo` the user who called it. Root forwards the connections of
    virtual machines, and can read everything anyway.
    """
    caller = environment.get("SUDO_UID", "") if user == _ROOT else ""
    return frozenset({user, _ROOT, *([int(caller)] if caller.isdecimal() else [])})


def is_of(users: Container[int], client: tuple[str, int], server: tuple[str, int]) -> bool:
    """Return True if a TCP connection over IPv4 was opened by a process of one of these users.

    Also where the kernel has no table of sockets in /proc: then nobody can tell.

    Args:
        users: the numbers of the users.
        client: the address and port of the client, on this machine.
        server: the address and port of the server.
    """
    wanted = _hexadecimal(client), _hexadecimal(server)
    try:
        table = _TABLE.read_text(encoding="ascii")
    except OSError:
        return True
    rows = (line.split() for line in table.splitlines()[1:])
    return any(
        (columns[_LOCAL], columns[_REMOTE]) == wanted and int(columns[_UID]) in users for columns in rows
    )


def _hexadecimal(address: tuple[str, int]) -> str:
    """Return an address as the table has it: in the byte order of this machine."""
    number = int.from_bytes(socket.inet_aton(address[0]), sys.byteorder)
    return f"{number:08X}:{address[1]:04X}"
