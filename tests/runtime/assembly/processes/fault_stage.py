"""A run of a behavior by real processes, watched from outside while some of them die or freeze.

What is measured is measured in the robot's time, which on its own machine is the monotonic clock: when a
signal was sent, which tick a decision belongs to, and how fast the robot really was.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from random import Random
from typing import NamedTuple

import zenoh

from colony.cli.run.led_run import PLANT_START_TIMEOUT_S
from colony.runtime.protocol import codec, topics
from colony.runtime.protocol.messages import Tick, Verdict
from colony.runtime.transport.live.network import ZenohSession, local_time
from colony.runtime.transport.live.robot_address import local
from colony.sim.plant.child import plant_socket
from colony.sim.plant.control import PlantControl
from tests.cli.machine import MAP, ROBOT, WANDER, Machine, Started, children_of
from tests.runtime.transport.live.stage import python_process
from tests.waiting import until

FRAME_NS = 50_000_000
LONG_S = "100000"
"""Seconds that a run would take: more than anybody watches it."""

UNHEARD = ("late", "lost", "refused")
_SPEC = re.compile(r"/([^/\0]+)\.json\0$")


class Speed(NamedTuple):
    """How fast the robot really was, at a time of the robot."""

    t_ns: int
    velocity: float


class Run:
    """Mutable: what was heard of it."""

    def __init__(
        self,
        machine: Machine,
        *options: str,
        seed: int,
        served: bool = False,
    ) -> None:
        """Start the run: a process for each server and one for the clients.

        With `served`, the servers share a process of `colony serve`, and the clients are in that of the run.
        """
        self.machine, self.random = machine, Random(seed)
        simulated, lasting = ("--map", MAP, "--seed", str(seed)), ("--duration", LONG_S, *options)
        if served:
            self.parent: Started = machine.start("serve", "all", "--robot", ROBOT, *simulated)
            self._wait_for_simulator()
            self.started: Started = machine.start("drive", WANDER, "--robot", ROBOT, *lasting)
        else:
            arguments = (*simulated, "--processes", "--isolate", "--no-picture", *lasting)
            self.parent = self.started = machine.start("run", WANDER, *arguments)
            self._wait_for_simulator()
        self.verdicts: deque[Verdict] = deque()
        self.ticks: deque[Tick] = deque()
        self._holds = ExitStack()
        robot_address = local(ROBOT, machine.environment)
        self.network = self._holds.enter_context(ZenohSession.open(robot_address))
        self.now: Callable[[], int] = local_time(robot_address)
        self.origin_ns = robot_address.directory.origin_ns()
        for topic in (topics.TICKS, topics.VERDICTS):
            handler = zenoh.handlers.Callback(self._hear, indirect=False)
            self.network.session.declare_subscriber(f"colony/{ROBOT}/{topic}", handler)

    def _wait_for_simulator(self) -> None:
        until(
            lambda: self.parent.ended() or self.machine.truth(),
            "the simulator starts",
            patience_s=PLANT_START_TIMEOUT_S,
        )
        assert not self.parent.ended(), self.parent.err

    def _hear(self, sample: zenoh.Sample) -> None:
        message = codec.decode(sample.payload.to_bytes())
        if isinstance(message, Tick):
            self.ticks.append(message)
        elif isinstance(message, Verdict) and message.actuator == "drive":
            self.verdicts.append(message)

    def close(self) -> None:
        self._holds.close()

    # --- how it goes -----------------------------------------------------------------------------------

    def since(self, t_ns: int) -> list[Verdict]:
        """The decisions of the frames that began after this time."""
        return [v for v in tuple(self.verdicts) if v.t_ns > t_ns]

    def well(self, t_ns: int) -> bool:
        """Whether, after this time, everybody was there for three frames in a row, the newest ones, and one
        of them commanded."""
        newest = self.since(t_ns)[-3:]
        ticks = [t for t in tuple(self.ticks) if t.t_ns > t_ns][-3:]
        return (
            len(newest) == len(ticks) == 3
            and not any(fate in UNHEARD for v in newest for _, fate in v.fates)
            and not any(t.down or t.lost for t in ticks)
            and newest[-1].by is not None
        )

    def goes_on(self) -> None:
        """Wait until all is well, and the robot drives."""
        since = self.now()
        until(lambda: self.ended() or self.well(since), "all are there again")
        until(lambda: self.ended() or self.machine.moves(), "the robot drives")
        assert not self.started.ended(), self.started.err

    def ended(self) -> bool:
        return self.started.ended()

    def driving(self) -> str:
        """The client that commands in the newest frame."""
        found = until(lambda: self.verdicts[-1].by if self.verdicts else None, "somebody commands")
        assert found is not None
        return found

    # --- its processes -----------------------------------------------------------------------------------

    def pids(self) -> dict[str, int]:
        """Return the processes that live, by name: servers, and `clients`."""
        found = {}
        for pid in children_of(self.parent.pid):
            try:
                spec = _SPEC.search(Path(f"/proc/{pid}/cmdline").read_text())
            except OSError:  # it just ended
                continue
            if spec is not None:
                found[spec[1]] = pid
        return found

    def pid(self, name: str) -> int | None:
        """The process of this name; None while there is none."""
        return self.pids().get(name)

    def signal(self, name: str, number: signal.Signals) -> tuple[int, int]:
        """Send it a signal, at any moment of a frame; gives its process and the time just after."""
        pid = until(lambda: self.pid(name), f"{name} is there")
        assert pid is not None
        time.sleep(self.random.random() * FRAME_NS / 1e9)
        os.kill(pid, number)
        return pid, self.now()

    # --- the robot itself --------------------------------------------------------------------------------

    @contextmanager
    def speeds(self) -> Iterator[list[Speed]]:
        """How fast it is, over and over again until the end of the block."""
        found: list[Speed] = []
        ended = threading.Event()

        def look() -> None:
            with PlantControl(plant_socket(self.machine.directory.path)) as control:
                while not ended.wait(0.002):
                    truth = control.truth(ROBOT)
                    found.append(Speed(truth.t_ns - self.origin_ns, truth.velocity))

        thread = threading.Thread(target=look)
        thread.start()
        try:
            yield found
        finally:
            ended.set()
            thread.join()


def child(machine: Machine, what: str) -> AbstractContextManager[subprocess.Popen[str]]:
    """A `fault_child`, killed in the end where it lives still."""
    return python_process(machine.environment, "-m", "tests.runtime.assembly.processes.fault_child", what)
