"""Calls as data: functions of a library return them, and a connection makes them.

    from colony.runtime.library import robot

    speed = connection.do(robot.speed_setting())

So each function is written once, whether a program waits for the answer or awaits it.
"""

from __future__ import annotations

from typing import Any, Generic, NamedTuple, TypeVar

import msgspec

from colony.runtime.protocol.calls import Nothing, Status
from colony.runtime.protocol.messages import Right

T = TypeVar("T")


class Ask(NamedTuple, Generic[T]):
    """A call of `method` with `arguments`, under `right`; the result is a `reply`.

    `repeatable`: the call may be made again if the server dies before it answers. `wait_s`: the time to wait
    for the answer, if that is longer than the connection's own timeout.
    """

    method: str
    arguments: msgspec.Struct
    reply: Any  # type[T], which cannot express `int | None`
    right: Right
    repeatable: bool = False
    wait_s: float | None = None


STATUS: Ask[Status] = Ask("status", Nothing(), Status, "read", repeatable=True)
"""Call of `status`: the connections of a server, and its limits that are reached."""
