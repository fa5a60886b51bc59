"""What servers there are besides those that every robot has, so that programs can be bound to them:
`bind(program, (*SERVERS, *discover(session, names)))`."""

from __future__ import annotations

from collections.abc import Iterable

from colony.runtime.kit.connection import Session
from colony.runtime.kit.description import describe, server_spec
from colony.runtime.protocol.fields import ServerSpec


def discover(session: Session, names: Iterable[str]) -> tuple[ServerSpec, ...]:
    """Ask each of these servers what it has.

    Raises:
        ServerNotFound: one is not there.
        CallRefused: one does not describe itself.
        ValueError: one describes what cannot be.
    """
    found: list[ServerSpec] = []
    for name in names:
        with session.connect(name, name="discovery") as connection:
            found.append(server_spec(connection.do(describe())))
    return tuple(found)
