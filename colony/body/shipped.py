"""The bodies of the robots that come with colony."""

from __future__ import annotations

from functools import cache

from colony.body.model import Body
from colony.body.reader import read_body
from colony.body.servers import servers_of
from colony.ir.servers import ServerSpec
from colony.shipped import Shipped
from colony.text.diagnostics import DiagnosticError

ROME = "rome"
"""The robot that stands in where nothing else is said, such as for a simulated robot without a body."""


@cache
def shipped_body(name: str) -> Body:
    """Return the body of a robot that comes with colony; it is read once a process.

    Raises:
        DiagnosticError: the file has errors, or there is none.
    """
    found = read_body(Shipped.ROBOT.path(name).with_suffix(".toml"))
    if found.body is None:
        raise DiagnosticError(found.diagnostics)
    return found.body


def shipped_servers(name: str) -> tuple[ServerSpec, ...]:
    """Return what the servers of a robot that comes with colony offer, as far as its devices say it.

    Raises:
        DiagnosticError: see `shipped_body`.
    """
    return servers_of(shipped_body(name))
