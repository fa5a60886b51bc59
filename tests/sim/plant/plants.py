"""Plants in processes of their own, for tests."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from colony.sim.plant.assembly import PlantOptions
from colony.sim.plant.control import PlantControl
from colony.sim.plant.process import serve_plant
from tests.paths import MAPS
from tests.waiting import PATIENCE_S, until

T = TypeVar("T")

START = (3000.0, 1500.0, 270.0)
OTHER = (12000.0, 1500.0, 270.0)
"""Where robots stand in the hallway."""


def wait_for(what: Callable[[], T | None]) -> T:
    """Return what a function gives as soon as it gives something that is true."""
    found = until(what, "the plant does it")
    assert found is not None
    return found


@contextmanager
def controlled(
    given: PlantOptions, *, clock: Callable[[], int] = time.monotonic_ns
) -> Iterator[PlantControl]:
    """A plant in a thread, and a connection that controls it."""
    ready, ended = threading.Event(), threading.Event()
    thread = threading.Thread(
        target=lambda: serve_plant(given, stop=ended.is_set, ready=ready.set, clock=clock)
    )
    thread.start()
    try:
        assert ready.wait(PATIENCE_S)
        with PlantControl(given.path, timeout_s=PATIENCE_S) as control:
            yield control
    finally:
        ended.set()
        thread.join()


class PlantProcess:
    """A plant in a process of its own. Mutable: it may be killed and started again.

    Args:
        path: of its socket.
        robots: by name, where each begins.
        body: the name of the robot whose body they have.
        building: the path of the map, the hallway by default.
    """

    def __init__(
        self,
        path: Path,
        robots: Mapping[str, tuple[float, float, float]],
        *,
        body: str = "rome",
        building: Path = MAPS / "hallway.stickrep",
    ) -> None:
        self.path = path
        options = [str(path), str(building), json.dumps(robots), body]
        self._command = [sys.executable, "-m", "tests.sim.plant.child", *options]
        self.process = self._start()

    def _start(self) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=MAPS.parent
        )
        assert process.stdout.readline() == "ready\n"
        return process

    def kill(self) -> None:
        """End it as a crash would."""
        self.process.kill()
        self._collect()

    def start_again(self) -> None:
        self.process = self._start()

    def end(self) -> int:
        """End it as it wants to be ended; gives its exit code."""
        self.process.stdin.close()
        return self._collect()

    def _collect(self) -> int:
        code = self.process.wait(PATIENCE_S)
        for stream in (self.process.stdin, self.process.stdout):
            stream.close()
        return code

    def __enter__(self) -> PlantProcess:
        return self

    def __exit__(self, *raised: object) -> None:
        if self.process.returncode is None:
            self.kill()
