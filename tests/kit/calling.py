"""Messages of calls, for tests that hand them to a server themselves."""

from __future__ import annotations

from typing import Any

import msgspec

from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import NoArguments, Open
from colony.runtime.protocol.messages import Call, Right

CLOSE: CallRequest[None] = CallRequest("close", NoArguments(), None, "read")
"""Ends a connection."""


def opening(name: str) -> CallRequest[None]:
    """Return what opens a connection that goes by a name."""
    return CallRequest("open", Open(name=name), None, "read")


def call_of(ask: CallRequest[Any], connection: str, number: int = 1, priority: int = 0) -> Call:
    """Return the message that asks a server."""
    return Call(
        connection=connection,
        number=number,
        method=ask.method,
        arguments=msgspec.Raw(msgspec.msgpack.encode(ask.arguments)),
        priority=priority,
        right=ask.right,
    )


def plain_call(connection: str, number: int = 1, *, priority: int = 0, right: Right = "command") -> Call:
    """Return a call without arguments of a method that no server has."""
    return call_of(CallRequest("m", None, None, right), connection, number, priority)  # type: ignore[arg-type]
