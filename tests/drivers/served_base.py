"""An emulated base in this process, whose servers and program are processes as on a real robot.

The robot notes when it heard what: the times are those at which a command was complete on its side.
"""

from __future__ import annotations

import os
import signal
import time
from bisect import bisect_left
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Protocol

from colony.drivers.create2 import create2
from colony.drivers.create2 import firmware as create2_firmware
from colony.drivers.emulator import Emulator
from colony.drivers.pioneer import firmware as pioneer_firmware
from colony.drivers.pioneer import pioneer
from colony.drivers.pioneer.parameters import MODELS
from colony.runtime.kit.connection import Session
from colony.runtime.transport.live.robot_address import Local, local
from colony.runtime.transport.live.run_directory import RunDirectory
from tests.cli.machine import Machine, Started, children_of, failed
from tests.waiting import until

BEHAVIOR = """
language 1
import robot

module ahead { when true          do drive(velocity = 50 mm/s, turn = 0) }
module back  { when front_bumper  do drive(velocity = -50 mm/s, turn = 0) }
network { drive = back suppresses ahead }
"""
"""A program that drives ahead, and answers its bumper."""

START_S = 300.0
"""Seconds that a base may take to drive, on a busy machine."""

SERVERS = {"Clock", "RServer", "DServer"}
"""What a program waits for only so long."""

STANDING_S = 0.08
"""Seconds without a command to move after which a base counts as stopped.

Longer than a late frame, and shorter than any restart: a host of clients is back after 100 ms of standing.
"""

FRESH_S = 0.1
"""Age up to which a command that moves counts as now."""


class Robot(Protocol):
    """What both emulated robots have."""

    touched: bool

    @property
    def set_points(self) -> tuple[float, float]: ...
    def receive(self, data: bytes) -> None: ...
    def step(self) -> None: ...
    def sent(self) -> list[bytes]: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Base:
    """An emulated base on a line.

    Attributes:
        robot: the name of its description.
        make: makes the robot, in an open field.
        velocity: returns the direction, by its sign, of set points.
        command_bytes: bytes of the commands of one frame.
        period_s: period of the packets with its readings.
        watchdog_s: time after which its watchdog stops it; None if it has none.
        stops_itself: returns True if the watchdog of this robot holds it.
    """

    robot: str
    baud: int
    make: Callable[[], Robot]
    velocity: Callable[[tuple[float, float]], float]
    command_bytes: int
    period_s: float
    watchdog_s: float | None
    stops_itself: Callable[[Robot], bool]

    @property
    def title(self) -> str:
        return f"{self.robot} at {self.baud:,}"


def pioneer_at(baud: int) -> Base:
    """Return a Pioneer at this baud rate."""
    return Base(
        robot="pioneer",
        baud=baud,
        make=lambda: pioneer_firmware.PioneerFirmware(MODELS["p3dx-sh"]),
        velocity=lambda points: points[0],
        command_bytes=len(pioneer.Pioneer().drive(50.0, 0.0)),
        period_s=0.1,
        watchdog_s=2.0,
        stops_itself=lambda robot: isinstance(robot, pioneer_firmware.PioneerFirmware) and robot.is_timed_out,
    )


CREATE2 = Base(
    robot="create2",
    baud=create2.Create2.baud,
    make=create2_firmware.Create2Firmware,
    velocity=sum,
    command_bytes=len(create2.Create2().drive(50.0, 0.0)),
    period_s=create2_firmware.STREAM_S,
    watchdog_s=None,
    stops_itself=lambda robot: False,
)


class NotedRobot:
    """A robot that notes its set points whenever bytes arrive. Mutable; of the emulator's thread.

    Attributes:
        heard: times of `time.monotonic`, and the set points after the bytes that arrived then.
        longest: length of the longest packet that it sent.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.heard: list[tuple[float, tuple[float, float]]] = []
        self.longest = 0

    def receive(self, data: bytes) -> None:
        self.robot.receive(data)
        if data:
            self.heard.append((time.monotonic(), self.robot.set_points))

    def step(self) -> None:
        self.robot.step()

    def sent(self) -> list[bytes]:
        packets = self.robot.sent()
        self.longest = max(self.longest, *map(len, packets), 0)
        return packets

    def first(self, since: float, wanted: Callable[[tuple[float, float]], bool]) -> float | None:
        """Return when set points that are wanted were first heard since then; None if not yet."""
        found = None
        for t, points in reversed(self.heard):
            if t < since:
                break
            found = t if wanted(points) else found
        return found

    def stood(self, since: float) -> float | None:
        """Return when it was stopped since then, for `STANDING_S` at least; None if not yet.

        A frame that is late on a busy machine is idle for its own 50 ms, and is no stop.
        """
        found = None
        first = bisect_left(self.heard, since, key=lambda heard: heard[0])
        for t, points in islice(self.heard, first, None):
            if found is not None and t > found + STANDING_S:
                break
            found = None if any(points) else found or t
        return found if found is not None and time.monotonic() > found + STANDING_S else None


class Served:
    """A base that is served, and driven by a program. Mutable: its processes."""

    def __init__(self, base: Base, emulator: Emulator[NotedRobot], folder: Path) -> None:
        self.base, self.emulator, self.robot = base, emulator, emulator.firmware
        self._machine = Machine(folder)
        self._program = folder / "answer.colony"
        self._program.write_text(BEHAVIOR)
        port = ("--port", emulator.port, "--baud", str(base.baud))
        self.supervisor = self._machine.start("serve", "all", "--robot", base.robot, *port)
        self.leader: Started | None = None

    def start(self, *arguments: str) -> Started:
        """Run `colony ARGUMENTS` beside it."""
        return self._machine.start(*arguments)

    # --- what is running -----------------------------------------------------------------------------

    @property
    def _runs(self) -> RunDirectory:
        return RunDirectory.find(self._machine.environment)

    def pid(self, server: str) -> int:
        """Return the process id of a server."""
        return self._runs.robot(self.base.robot).running()[server]

    @property
    def robot_address(self) -> Local:
        """The address of the robot that is served."""
        return local(self.base.robot, self._machine.environment)

    def session(self) -> Session:
        """Return a session with the robot, as an outside program has one."""
        return Session.open(self.base.robot, environment=self._machine.environment)

    @property
    def guard(self) -> int:
        """The process id of the port's guard."""
        return int(Path(f"{self._runs.guard(self.emulator.port)}.lock").read_text())

    # --- driving -------------------------------------------------------------------------------------

    def moves(self) -> bool:
        """Return True if it was just commanded to move ahead."""
        if not self.robot.heard:
            return False
        t, points = self.robot.heard[-1]
        return time.monotonic() - t < FRESH_S and self.base.velocity(points) > 0.0

    def drive(self) -> None:
        """Have the program drive it, for ten commands in a row; it is started unless it runs."""
        until(self._drives, f"{self.base.title} drives", patience_s=START_S)

    def _drives(self) -> bool:
        failed(self.supervisor)
        if self.leader is None or self.leader.ended():
            if self._runs.robot(self.base.robot).running().keys() >= SERVERS:
                self.leader = self._machine.start("drive", os.fspath(self._program), *self._connected)
            return False
        last = self.robot.heard[-10:]
        return len(last) == 10 and self.moves() and all(self.base.velocity(one) > 0.0 for _, one in last)

    @property
    def _connected(self) -> tuple[str, ...]:
        return ("--robot", self.base.robot)

    def end_program(self) -> None:
        """End the program, which may be frozen."""
        if self.leader is not None:
            left = children_of(self.leader.pid)
            self.leader.tell(signal.SIGKILL)
            self.leader.process.wait()
            for pid in left:
                os.kill(pid, signal.SIGCONT)
            self.leader = None

    def close(self) -> None:
        """End all processes."""
        self.end_program()
        self.supervisor.tell(signal.SIGCONT)
        self._machine.close()


@contextmanager
def served(base: Base, folder: Path) -> Iterator[Served]:
    """Serve a base, with files in a folder, and end all that drives it."""
    with ExitStack() as stack:
        emulator = Emulator(NotedRobot(base.make()), baud=base.baud, link=folder / "port")
        stack.enter_context(closing(emulator))
        emulator.start()
        yield stack.enter_context(closing(Served(base, emulator, folder)))
