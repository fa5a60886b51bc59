"""A server written with the kit, for tests: in a thread, or as a process of its own."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager

import msgspec

from colony.runtime.kit.server import Field, Method, Offer, Reading, Server, Servers, field, method
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.calls import NoArguments, RefusedError
from colony.runtime.protocol.connections import Caller
from tests.runtime.transport.live.stage import ROBOT, python_process
from tests.waiting import until

BATTERY = "Battery"


class Charge(msgspec.Struct, frozen=True, kw_only=True):
    amperes: float


class Battery:
    """Mutable: how full it is, and how often somebody asked for what."""

    def __init__(self) -> None:
        self.level = 0.5
        self.charges = 0
        self.wait = threading.Event()
        self.wait.set()

    def methods(self) -> list[Method]:
        return [
            method("level", NoArguments, lambda caller, nothing: self.level, right="read"),
            method("charge", Charge, self.charge),
            method("who", NoArguments, lambda caller, nothing: list(caller), right="read"),
            method("fail", NoArguments, lambda caller, nothing: 1 / 0),
            method("wait", NoArguments, lambda caller, nothing: self.wait.wait(20)),
            method("halt", NoArguments, lambda caller, nothing: "halted", right="stop"),
        ]

    def fields(self) -> list[Field]:
        return [
            field("level", lambda: self.level, meaning="how full it is, 0 to 1"),
            field("cells", lambda: Reading((3.0, 4.0), age_ns=1_000_000), size=2, has_age=True),
            field("broken", lambda: 1 / 0),
            field("nothing", lambda: None, boolean=True),
        ]

    def charge(self, caller: Caller, given: Charge) -> float:
        if given.amperes < 0:
            raise RefusedError("range", f"{given.amperes:g} A: expected 0 or more")
        self.charges += 1
        self.level += given.amperes / 10
        return self.level


def level() -> CallRequest[float]:
    return CallRequest("level", NoArguments(), float, "read", repeatable=True)


def charge(amperes: float) -> CallRequest[float]:
    return CallRequest("charge", Charge(amperes=amperes), float, "command")


def plain(name: str, reply: object = None, *, repeatable: bool = False) -> CallRequest[object]:
    return CallRequest(name, NoArguments(), reply or object, "command", repeatable=repeatable)


def halt() -> CallRequest[str]:
    return CallRequest("halt", NoArguments(), str, "stop")


@contextmanager
def battery_thread(
    environment: Mapping[str, str], *, report: Callable[[str], None] = lambda problem: None
) -> Iterator[Battery]:
    """The server in a thread."""
    battery, failures = Battery(), list[BaseException]()
    with Server.open(BATTERY, robot=ROBOT, environment=environment, report=report) as server:

        def serve() -> None:
            try:
                server.mainloop(battery.methods(), fields=battery.fields())
            except BaseException as failure:
                failures.append(failure)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield battery
        finally:
            battery.wait.set()
            server.exitloop()
            thread.join(20)
            assert not thread.is_alive()
            assert not failures, failures


def battery_process(environment: Mapping[str, str]) -> AbstractContextManager[subprocess.Popen[str]]:
    """The server as a process, killed in the end if it is still there."""
    return python_process(environment, "-m", "tests.runtime.kit.stage", says="ready")


def several_process(environment: Mapping[str, str]) -> AbstractContextManager[subprocess.Popen[str]]:
    """A process with the servers Lidar and Button, killed in the end if it is still there."""
    return python_process(environment, "-m", "tests.runtime.kit.stage", "several", says="ready")


def gone(process: subprocess.Popen[str]) -> None:
    """Kill it, and see it dead."""
    process.kill()
    until(lambda: process.poll() is not None, "it is dead")


def main() -> None:
    """The server, until somebody ends it by a signal."""
    battery = Battery()
    with Server.open(BATTERY, robot=ROBOT) as server:
        signal.signal(signal.SIGTERM, lambda *_: server.exitloop())
        print("ready", flush=True)
        server.mainloop(battery.methods(), fields=battery.fields())


def several() -> None:
    """Two servers, until somebody ends them by a signal."""
    scan = field("scan", lambda: Reading((1.0, 2.0), age_ns=0), unit="mm", size=2, has_age=True)
    press = method("press", NoArguments, lambda caller, nothing: "Button was pressed")
    with Servers.open("Lidar", "Button", robot=ROBOT) as servers:
        signal.signal(signal.SIGTERM, lambda *_: servers.exitloop())
        print("ready", flush=True)
        servers.mainloop(
            {
                "Lidar": Offer(fields=[scan]),
                "Button": Offer(methods=[press], fields=[field("pressed", lambda: True, boolean=True)]),
            }
        )


if __name__ == "__main__":
    several() if sys.argv[1:] else main()
