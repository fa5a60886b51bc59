"""Scripts beside the parts of real servers, moment by moment; and a robot that is where tests put it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

from colony.runtime.assembly.loop import LocalCamera, LocalData, LocalScripts, LocalServer
from colony.runtime.kit.script import Script
from colony.runtime.library import data
from colony.runtime.library.ask import CallRequest
from colony.runtime.library.robot import PoseArguments, Position
from colony.runtime.protocol.calls import CallId, Handler
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.images import Shot

FRAME_NS = 50_000_000
ASKED = CallId(Caller("local/test", "test", 0, "local"), 1)


class Server(LocalServer):
    """A server that a test makes up."""

    def __init__(self, address: str, handlers: Mapping[str, Handler]) -> None:
        super().__init__(address, ())
        self.handlers = handlers


class Shutter:
    """A camera driver that gives what `take` gives."""

    def __init__(self, take: Callable[[], Shot]) -> None:
        self.grab = take


class ScriptStage:
    """Scripts, a data server and other servers. Mutable: the time, and all of them."""

    now_ns: int = 0

    def __init__(
        self, scripts: Mapping[str, Script], *servers: LocalServer, cameras: Sequence[LocalCamera] = ()
    ) -> None:
        self.data = LocalData()
        self._cameras = cameras
        self._servers = [self.data, *servers, *cameras]
        self.names = set(scripts)
        self.scripts = LocalScripts(scripts, self._servers)

    def begin(self, **scripts: Script) -> None:
        """Run other scripts, in place of those until now, which are lost."""
        self.scripts.close()
        for name in self.names:
            self.data.semaphores.drop(f"local/{name}")
        self.names = set(scripts)
        self.scripts = LocalScripts(scripts, self._servers)

    def settle(self) -> None:
        """Let cameras and scripts do all that they do at this moment."""
        for camera in self._cameras:
            camera.poll(self.now_ns)
        self.data.expire(self.now_ns)
        self.scripts.run(self.now_ns)

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

    def signal(self, semaphore: str) -> None:
        """Signal a semaphore as another client."""
        self.ask(data.signal(semaphore))

    def ask(self, asked: CallRequest[Any]) -> Any:
        """Ask the data server, as another script does."""
        return self.data.do(ASKED, asked, self.now_ns)

    def tell(self, name: str, value: object) -> None:
        """Set a variable."""
        self.ask(data.set(name, value))

    def variable(self, name: str) -> Any:
        """A variable, which was set."""
        return self.ask(data.get(name))

    def told(self, name: str) -> Any:
        """A variable; None where it was never set."""
        return self.data.value(name)

    def semaphore(self, name: str) -> int:
        """How far a semaphore is up."""
        return int(self.ask(data.semaphore(name)).value)


class RobotStage(ScriptStage):
    """Scripts beside a robot, in frames. Mutable: the time, the variables, the semaphores, the robot.

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

    def said(self, script: str, *methods: str) -> list[dict[str, Any]]:
        """Return the arguments of a script's calls of these methods."""
        return [arguments for by, method, arguments in self.calls if by == script and method in methods]

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
        case data.NameArguments(name=name):
            return {name: None}
        case _:
            return {}
