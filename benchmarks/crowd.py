"""Some of a hundred clients in one process: each tells RServer in every frame that it is silent, but for the
last of all, which commands.

    python -m benchmarks.crowd FOLDER ROBOT RUN FIRST BEHIND ALL
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from colony.runtime.assembly.processes.shutdown import Shutdown, on_parent_exit, on_signals
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Effect, Message, Ready, Request, SendMessage, Tick
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.robot_address import Local
from colony.runtime.transport.live.run_directory import RobotDirectory

ACTUATOR = "drive"
SERVER = "RServer"


class Crowd:
    """The clients `first` up to, not with, `behind` of `all_of_them`. Mutable: the frame answered last."""

    def __init__(self, run: str, first: int, behind: int, all_of_them: int) -> None:
        self.address = f"crowd/{first}"
        self.listens = (topics.TICKS,)
        self._run = run
        self._names = [f"m{i}" for i in range(first, behind)]
        self._commands = f"m{all_of_them - 1}"
        self._k = -1

    def start(self, now_ns: int) -> Iterator[Effect]:
        yield from map(self._ready, self._names)

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        if not isinstance(message, Tick):
            return ()
        if message.run != self._run:
            return self.start(now_ns)
        if message.k <= self._k:
            return ()
        self._k = message.k
        return [
            effect
            for name in self._names
            for effect in (
                SendMessage(topics.requests(SERVER), self._request(name, message.k)),
                self._ready(name, message.k),
            )
        ]

    def close(self) -> None:
        pass

    def _ready(self, name: str, k: int = -1) -> Effect:
        client = topics.client_address(ACTUATOR, name)
        return SendMessage(topics.READY, Ready(client=client, run=self._run, k=k))

    def _request(self, name: str, k: int) -> Request:
        if name == self._commands:
            return Request(k=k, actuator=ACTUATOR, client=name, bid="command", values=(100.0, 0.0))
        return Request(k=k, actuator=ACTUATOR, client=name, bid="silent")


def main() -> None:
    folder, robot, run, *numbers = sys.argv[1:]
    shutdown = Shutdown()
    on_parent_exit(shutdown)
    crowd = Crowd(run, *map(int, numbers))
    robot_address = Local(RobotDirectory(Path(folder), robot))
    with on_signals(shutdown), Host.open(robot_address, [crowd]) as host:
        shutdown.on_request(host.stop)
        host.run()


if __name__ == "__main__":
    main()
