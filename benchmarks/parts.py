"""Processor time by part of a process: `python -m benchmarks.parts MODULE ARGUMENTS`.

It runs a module as `python -m` would, with clocks around the functions that parts consist of, and likewise
every process that this one starts. When told to by the signal `TELL`, a process writes the milliseconds that
it has taken so far, by part, into a file of the folder `COLONY_PARTS`. The measurement itself slows a process
down by a few percent.
"""

from __future__ import annotations

import importlib
import json
import os
import runpy
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

FOLDER = "COLONY_PARTS"

TELL = signal.SIGUSR1

PARTS = {
    "decode": (
        "colony.runtime.protocol.codec:decode_all",
        "colony.runtime.transport.live.host:check_plausible",
    ),
    "encode": ("colony.runtime.protocol.codec:encode",),
    "send": ("colony.runtime.transport.live.outbox:Outbox._put",),
    "assemble": (
        "colony.runtime.frames.assembler:FrameAssembler.take",
        "colony.runtime.frames.assembler:FrameAssembler._assemble",
    ),
    "step": ("colony.runtime.clients.client_program:ClientProgram.step",),
    "monitor": ("colony.runtime.observe.monitor:Monitor.check",),
    "record": ("colony.runtime.recordings.mcap_writer:McapRecording.take",),
    "devices": (
        "colony.sim.plant.drivers:_DeviceConnection._handle",
        "colony.sim.plant.drivers:_DeviceConnection.send",
        "colony.sim.plant.drivers:read_from_plant",
    ),
    "nodes": (
        "colony.runtime.transport.live.host:Host._deliver",
        "colony.runtime.transport.live.host:Host._wake",
    ),
}
"""Functions by part. What one of them calls of another part counts for that one."""


class Clocks:
    """Processor time by part. Mutable: the times so far; threads share it."""

    def __init__(self) -> None:
        self.ns: Counter[str] = Counter()
        self._inside = threading.local()

    def around(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return `function` with a clock around it."""

        def timed(*arguments: Any, **named: Any) -> Any:
            stack: list[int] = self._inside.__dict__.setdefault("stack", [])
            begun = time.thread_time_ns()
            stack.append(0)
            try:
                return function(*arguments, **named)
            finally:
                took = time.thread_time_ns() - begun
                self.ns[part] += took - stack.pop()
                if stack:
                    stack[-1] += took

        return timed

    def install(self) -> None:
        """Put the clocks around what there is in this process."""
        for part, places in PARTS.items():
            for place in places:
                module, _, path = place.partition(":")
                owner: Any = importlib.import_module(module)
                *inner, name = path.split(".")
                for step in inner:
                    owner = getattr(owner, step)
                setattr(owner, name, self.around(part, getattr(owner, name)))


def _tell(clocks: Clocks, path: Path) -> None:
    """Write the times so far, whole or not at all."""
    beside = path.with_suffix(".new")
    beside.write_text(json.dumps({part: ns / 1e6 for part, ns in clocks.ns.copy().items()}))
    beside.replace(path)


def main() -> None:
    """Run a module with clocks."""
    from colony.runtime.assembly.processes.children import Children

    module, *arguments = sys.argv[1:]
    clocks = Clocks()
    clocks.install()
    start = Children.start
    Children.start = lambda self, job: start(  # type: ignore[method-assign]
        self, replace(job, module="benchmarks.parts", arguments=(job.module, *job.arguments))
    )
    name = Path(arguments[0]).stem if arguments and arguments[0].endswith(".json") else "leader"
    path = Path(os.environ[FOLDER]) / f"{name}.json"
    signal.signal(TELL, lambda *_: _tell(clocks, path))
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
