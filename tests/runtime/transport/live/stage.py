"""What tests of the live transport stand on: run directories of their own, and hosts in threads."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from colony.runtime.protocol.messages import Effect, Message, Node
from colony.runtime.transport.live.host import Host
from colony.runtime.transport.live.robot_address import Local, local
from tests.paths import ROOT
from tests.waiting import PATIENCE_S, killed_in_the_end, until

ROBOT = "rome"


@contextmanager
def run_directory() -> Iterator[Mapping[str, str]]:
    """An environment with a run directory of its own; its path is short, as sockets need it."""
    folder = Path(tempfile.mkdtemp(prefix="colony-", dir="/tmp"))
    try:
        yield {"COLONY_RUN_DIR": str(folder)}
    finally:
        shutil.rmtree(folder)


def robot_address(environment: Mapping[str, str]) -> Local:
    """The robot of the tests."""
    return local(ROBOT, environment)


@contextmanager
def python_process(
    environment: Mapping[str, str], *arguments: str, says: str = ""
) -> Iterator[subprocess.Popen[str]]:
    """A process of Python that has said this line first, killed in the end where it lives still."""
    started = subprocess.Popen(
        [sys.executable, *arguments],
        env={**os.environ, **environment, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    )
    with killed_in_the_end(started) as process:
        assert process.stdout is not None
        assert not says or process.stdout.readline() == f"{says}\n"
        yield process


class Running:
    """A host that runs in a thread. Mutable: until it is ended."""

    def __init__(self, host: Host) -> None:
        self.host = host
        self.failures: list[BaseException] = []
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self) -> None:
        try:
            self.host.run()
        except BaseException as failure:
            self.failures.append(failure)

    def end(self) -> None:
        """Stop it, and raise what made it fail."""
        self.host.stop()
        self.thread.join(PATIENCE_S)
        assert not self.thread.is_alive(), "the host did not stop"
        self.host.close()
        if self.failures:
            raise self.failures[0]


@contextmanager
def running(host: Host) -> Iterator[Running]:
    """A host that runs in a thread until the end of the block."""
    run = Running(host)
    try:
        yield run
    finally:
        run.end()


@contextmanager
def hosted(
    environment: Mapping[str, str],
    nodes: Sequence[Node],
    *,
    report: Callable[[str], None] = lambda problem: None,
) -> Iterator[Host]:
    """A process's worth of nodes that serve, in a thread."""
    host = Host.open(robot_address(environment), nodes, serves=True, report=report)
    with running(host):
        names = {node.address for node in nodes}
        until(lambda: names <= set(host.network.alive()), f"{names} are not there")
        yield host


class Recorder:
    """A node that keeps what it gets. Mutable: that.

    `on` gives its effects for a message; by default there are none.
    """

    def __init__(
        self,
        address: str,
        *listens: str,
        on: Callable[[Message, int], Iterable[Effect]] = lambda message, now_ns: (),
        begin: Callable[[int], Iterable[Effect]] = lambda now_ns: (),
    ) -> None:
        self.address = address
        self.listens = listens
        self.got: list[Message] = []
        self.times: list[int] = []
        self.closed = 0
        self._on = on
        self._begin = begin

    def start(self, now_ns: int) -> Iterable[Effect]:
        return self._begin(now_ns)

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        self.got.append(message)
        self.times.append(now_ns)
        return self._on(message, now_ns)

    def close(self) -> None:
        self.closed += 1
