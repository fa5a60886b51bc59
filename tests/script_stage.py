"""Scripts beside the parts of real servers, moment by moment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from colony.runtime.assembly.loop import LocalCamera, LocalData
from colony.runtime.kit.script import Script
from colony.runtime.kit.script_local import LocalScripts, LocalServer
from colony.runtime.library import data
from colony.runtime.library.ask import Ask
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

    def ask(self, asked: Ask[Any]) -> Any:
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
