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
    """Call `method` with `arguments`, under `right`; the result is a `reply`.

    `repeatable`: where the server dies before it answered, the call may be made again.
    `wait_s`: for how long to wait for the answer, where that is longer than the connection's own time-out.
    """

    method: str
    arguments: msgspec.Struct
    reply: Any  # type[T], which cannot say `int | None`
    right: Right
    repeatable: bool = False
    wait_s: float | None = None


STATUS: Ask[Status] = Ask("status", Nothing(), Status, "read", repeatable=True)
"""Ask a server who is connected to it, and which of its limits are reached."""
