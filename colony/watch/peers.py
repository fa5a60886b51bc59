"""The user at the other end of a connection on this machine, as the kernel's table of sockets says."""

from __future__ import annotations

import os
import socket
import sys
from pathlib import Path

_TABLE = Path("/proc/net/tcp")
_LOCAL, _REMOTE, _UID = 1, 2, 7  # columns
_ROOT = 0


def is_of_user(client: tuple[str, int], server: tuple[str, int], user: int | None = None) -> bool:
    """Return True if a TCP connection over IPv4 was opened by a process of a user, or by root.

    So another user cannot pass on what a page and its server say. Root may: it forwards connections of
    virtual machines, and can read everything anyway.

    Args:
        client: the address and port of the client, on this machine.
        server: the address and port of the server.
        user: the number of the user; by default the user of this process.
    """
    wanted = _hexadecimal(client), _hexadecimal(server)
    for line in _TABLE.read_text(encoding="ascii").splitlines()[1:]:
        columns = line.split()
        if (columns[_LOCAL], columns[_REMOTE]) == wanted:
            return int(columns[_UID]) in (os.getuid() if user is None else user, _ROOT)
    return False


def _hexadecimal(address: tuple[str, int]) -> str:
    """Return an address as the table has it: in the byte order of this machine."""
    number = int.from_bytes(socket.inet_aton(address[0]), sys.byteorder)
    return f"{number:08X}:{address[1]:04X}"
