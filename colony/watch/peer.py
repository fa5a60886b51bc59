"""The user at the other end of a connection on the loopback interface, as the system knows them."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

CONNECTIONS = Path("/proc/net/tcp")
"""Linux' table of the TCP connections over IPv4, with their users."""

_LOCAL, _REMOTE, _USER = 1, 2, 7
"""Columns of the table."""


def is_stranger(port: int, server_port: int) -> bool:
    """Return True if the peer of a connection is known to be another user.

    Root is no stranger, nobody is one to a server of root, and nobody is one on a system that does not say
    whose a connection is.

    Args:
        port: port of the peer.
        server_port: port of the server.
    """
    with suppress(OSError), CONNECTIONS.open() as table:
        return user_of(table, port, server_port) not in (None, 0, os.geteuid()) and os.geteuid() != 0
    return False


def user_of(table: Iterable[str], port: int, server_port: int) -> int | None:
    """Return the number of the user whose connection leads from a port to a server; None if there is none."""
    wanted = f":{port:04X}", f":{server_port:04X}"
    for row in table:
        cells = row.split()
        if len(cells) > _USER and cells[_LOCAL].endswith(wanted[0]) and cells[_REMOTE].endswith(wanted[1]):
            return int(cells[_USER])
    return None
