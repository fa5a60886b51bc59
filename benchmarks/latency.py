"""How long after its tick a command reaches the driver: `python -m benchmarks.latency MODULE ARGUMENTS`.

It runs a module as `python -m` would, and likewise every process that this one starts. The process with
RServer writes, when told to by the signal `TELL`, how many milliseconds after their ticks the newest commands
came, into a file of the folder `COLONY_LATENCY`.
"""

from __future__ import annotations

import json
import os
import runpy
import signal
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

FOLDER = "COLONY_LATENCY"

TELL = signal.SIGUSR1

NEWEST = 10_000
"""Number of commands that are kept."""


def _noting(found: deque[float]) -> None:
    """Note how long after the newest tick that RServer took its driver has each command."""
    from colony.runtime.protocol.messages import Tick
    from colony.runtime.servers.base import Base
    from colony.runtime.servers.rserver import RServer

    newest = [0]
    handle: Callable[..., Any] = RServer.handle
    drive: Callable[..., Any] = Base.drive

    def noting_tick(server: RServer, message: object, now_ns: int) -> Any:
        if isinstance(message, Tick):
            newest[0] = time.monotonic_ns() - (now_ns - message.t_ns)
        return handle(server, message, now_ns)

    def noting_command(base: Base, *arguments: Any) -> Any:
        bumper = drive(base, *arguments)
        found.append((time.monotonic_ns() - newest[0]) / 1e6)
        return bumper

    RServer.handle = noting_tick  # type: ignore[method-assign]
    Base.drive = noting_command  # type: ignore[method-assign]


def main() -> None:
    """Run a module, and note its commands."""
    from colony.runtime.assembly.processes.children import Children

    module, *arguments = sys.argv[1:]
    found: deque[float] = deque(maxlen=NEWEST)
    _noting(found)
    start = Children.start
    Children.start = lambda self, job: start(  # type: ignore[method-assign]
        self, replace(job, module="benchmarks.latency", arguments=(job.module, *job.arguments))
    )

    def tell(*_: object) -> None:
        if found:
            path = Path(os.environ[FOLDER]) / f"{os.getpid()}.json"
            path.with_suffix(".new").write_text(json.dumps([*found]))
            path.with_suffix(".new").replace(path)
            found.clear()

    signal.signal(TELL, tell)
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
