"""Calls as data: the functions of a library return them, and connections make them.

    from colony.runtime.library import robot

    speed = connection.do(robot.speed_setting())

So the same functions serve both blocking and asyncio connections.
"""

from __future__ import annotations

from typing import Any, Generic, NamedTuple, TypeVar

import msgspec

from colony.runtime.protocol.calls import NoArguments, Status
from colony.runtime.protocol.messages import Right

T = TypeVar("T")


class CallRequest(NamedTuple, Generic[T]):
    """A call of `method` with `arguments`, under `right`. `reply` is the type of its result.

    `repeatable` is True if the call may be repeated when the server crashes before it answers. `wait_s` is
    the timeout of the call, if that is longer than the connection's.
    """

    method: str
    arguments: msgspec.Struct
    reply: Any  # type[T], which cannot express `int | None`
    right: Right
    repeatable: bool = False
    wait_s: float | None = None


STATUS: CallRequest[Status] = CallRequest("status", NoArguments(), Status, "read", repeatable=True)
"""The call `status`: the connections of a server, and the limits that it reached."""
