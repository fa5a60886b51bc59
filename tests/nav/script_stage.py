"""Scripts beside DServer's parts and a robot that is where tests put it, in frames of 50 ms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from colony.runtime.kit.script import Script
from colony.runtime.library import data
from colony.runtime.library.robot import PoseArguments, Position
from colony.runtime.protocol.calls import CallId, Handler
from tests.script_stage import FRAME_NS, ScriptStage, Server


class Stage(ScriptStage):
    """Mutable: the time, the variables, the semaphores, the robot.

    `calls` are the calls that change something, as (script, method, arguments by name), in their order.
    """

    def __init__(self, **scripts: Script) -> None:
        self.x = self.y = self.heading = 0.0
        self.calls: list[tuple[str, str, dict[str, Any]]] = []
        robot = {"position": self._position, "adjust_position": self._recording("adjust", self._adjust)}
        super().__init__(scripts, Server("RServer", robot))
        self.data.handlers = dict(self.data.handlers) | {
            method: self._recording(method, self.data.handlers[method])
            for method in ("set", "set_many", "create_semaphore", "signal")
        }

    @property
    def ended(self) -> set[str]:
        """Who has come to the end."""
        return {name for name in self.names if self.scripts.has_ended(name)}

    def run(self, seconds: float, each_frame: Callable[[], None] = lambda: None) -> None:
        """Frame by frame, until the time is over or all scripts have ended."""
        for _ in range(round(seconds * 1e9) // FRAME_NS):
            self.settle()
            if self.ended == self.names:
                return
            self.now_ns += FRAME_NS
            each_frame()

    def said(self, script: str, *methods: str) -> list[dict[str, Any]]:
        """Return the arguments of a script's calls of these methods."""
        return [arguments for by, method, arguments in self.calls if by == script and method in methods]

    def signal(self, semaphore: str) -> None:
        """Signal a semaphore as another client."""
        self.ask(data.signal(semaphore))

    def _recording(self, method: str, handler: Handler) -> Handler:
        def record(asked: CallId, arguments: Any, now_ns: int) -> object:
            self.calls.append((asked.caller.name, method, _arguments(arguments)))
            return handler(asked, arguments, now_ns)

        return record

    def _position(self, asked: CallId, arguments: object, now_ns: int) -> Position:
        return Position(x=self.x, y=self.y, heading=self.heading % 360.0, t_ns=now_ns)

    def _adjust(self, asked: CallId, arguments: PoseArguments, now_ns: int) -> None:
        self.x, self.y = self.x + arguments.x, self.y + arguments.y
        self.heading += arguments.heading


def _arguments(arguments: Any) -> dict[str, Any]:
    match arguments:
        case data.Set(name=name, value=value):
            return {name: msgspec.msgpack.decode(value)}
        case data.SetMany(values=values):
            decoded: dict[str, Any] = msgspec.msgpack.decode(values)
            return decoded
        case data.CreateSemaphore(name=name, value=value):
            return {name: value}
        case data.Named(name=name):
            return {name: None}
        case _:
            return {}
