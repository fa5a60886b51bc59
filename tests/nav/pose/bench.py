"""A robot in the simulator that runs one script, frame by frame, in place of the servers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.stickrep.model import EdgeKind
from colony.nav.maps.walls import Walls
from colony.runtime.kit.errors import CallRefused
from colony.runtime.kit.script import Do, Script, Sleep, Step
from colony.runtime.library import data
from colony.runtime.library.proximity import SonarReading
from colony.runtime.library.robot import PoseArguments, Position
from colony.runtime.servers.drivers import BaseState
from colony.runtime.servers.virtual_position import Odometer, Pose
from colony.sim.world.world import World

Floats = NDArray[np.float64]

FRAME_NS = 50_000_000


class Bench:
    """One robot of a world, its odometry as RServer gives it, and the variables and semaphores of DServer."""

    def __init__(
        self, world: World, script: Script, *, cross_talk: float = 0.0, seed: int = 0, lag: bool = False
    ) -> None:
        """`lag`: the sonars give what they read a frame ago."""
        self.world, self.t_ns, self.adjusted = world, 0, 0
        self.variables: dict[str, object] = {}
        self.semaphores: dict[str, int] = {}
        self._script, self._cross_talk = script, cross_talk
        self._random = np.random.default_rng(seed)
        self._odometer = Odometer(None)
        self._odometer.observe(self._base())
        self._until_ns = 0
        self._step: Step = next(script)
        self._asleep = False
        self._lag = lag
        self._scans = [self._scan()] * 2

    @property
    def believed(self) -> Pose:
        """Where RServer says that the robot is."""
        return self._odometer.observe(self._base())

    @property
    def heading_error_deg(self) -> float:
        return math.remainder(self.believed.heading - self.world.true_pose(0).heading_deg, 360.0)

    @property
    def position_error_mm(self) -> tuple[float, float]:
        true = self.world.true_pose(0)
        return self.believed.x - true.x_mm, self.believed.y - true.y_mm

    def adjust(self, dx: float, dy: float, dheading: float) -> None:
        """Correct RServer's position as another client would."""
        self._odometer.adjust(self._base(), Pose(dx, dy, dheading))

    def slip(self, turn_deg: float, back_mm: float = 0.0) -> None:
        """Turn and set back the robot without its odometry noticing."""
        x, y, heading = self.world.true_pose(0)
        angle = math.radians(heading)
        place = (x + back_mm * math.sin(angle), y - back_mm * math.cos(angle), heading + turn_deg)
        self.world.place(0, place)

    def frame(self, velocity: float, turn: float) -> None:
        """Drive for 50 ms, then let the script do what it can do."""
        self.world.command(0, velocity, turn)
        self.world.advance(FRAME_NS / 1e9)
        self.t_ns += FRAME_NS
        self._odometer.observe(self._base())
        self._scans = [self._scans[-1], self._scan()]
        while True:
            match self._step:
                case Sleep(seconds):
                    if not self._asleep:
                        self._asleep, self._until_ns = True, self.t_ns + round(seconds * 1e9)
                    if self.t_ns < self._until_ns:
                        return
                    self._asleep, self._step = False, self._script.send(self.t_ns)
                case Do("DServer", asked) if asked.method == "wait" and not self._can_take(asked.arguments):
                    if asked.arguments.wait_ns != 0:
                        return
                    self._step = self._script.throw(CallRefused("timeout", "was not signaled in time"))
                case Do(server, asked):
                    try:
                        answer = self._answer(server, asked.method, asked.arguments)
                    except CallRefused as refused:
                        self._step = self._script.throw(refused)
                    else:
                        self._step = self._script.send(answer)

    def _can_take(self, wanted: data.Wait) -> bool:
        return self.semaphores[wanted.name] > 0

    def _answer(self, server: str, method: str, asked: Any) -> object:
        match server, method:
            case "PServer", "sonar":
                return self._scans[0 if self._lag else 1]
            case "RServer", "position":
                at = self.believed
                return Position(x=at.x, y=at.y, heading=at.heading, t_ns=self.t_ns)
            case "RServer", "adjust_position":
                assert isinstance(asked, PoseArguments)
                self.adjusted += 1
                self.adjust(asked.x, asked.y, asked.heading)
                return None
            case "DServer", "create_semaphore":
                return self.semaphores.setdefault(asked.name, asked.value)
            case "DServer", "wait":
                self.semaphores[asked.name] -= 1
                return None
            case "DServer", "get" | "get_many":
                names = asked.names if method == "get_many" else (asked.name,)
                if missing := [name for name in names if name not in self.variables]:
                    raise CallRefused("unset", f"{missing[0]} was never set")
                found = {name: self.variables[name] for name in names}
                return found if method == "get_many" else found[asked.name]
            case "DServer", "set":
                self.variables[asked.name] = msgspec.msgpack.decode(asked.value)
                return None
        raise AssertionError(f"the bench has no {server}.{method}")

    def _scan(self) -> SonarReading:
        ranges = self.world.sonar(0)
        if self._cross_talk:
            false = self._random.random(len(ranges)) < self._cross_talk
            ranges = np.where(false, self._random.uniform(300.0, np.maximum(ranges, 301.0)), ranges)
        return SonarReading(t_ns=self.t_ns, ranges=tuple(ranges.tolist()))

    def _base(self) -> BaseState:
        x, y, heading = self.world.odometry(0)
        return BaseState(
            t_ns=self.t_ns, x=x, y=y, heading=heading,
            front_bumper=False, rear_bumper=False, speed=0.0, turn_rate=0.0, wheel_speed=0.0,
        )  # fmt: skip


class Log:
    """How the robot was off in each frame: heading in degrees, x and y in mm, and the way so far in mm."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, float, float, float]] = []

    def note(self, bench: Bench) -> None:
        """Write down how it is now."""
        x, y = bench.position_error_mm
        self._rows.append((bench.heading_error_deg, x, y, bench.world.distance(0)))

    @property
    def heading(self) -> Floats:
        return self._column(0)

    @property
    def x(self) -> Floats:
        return self._column(1)

    @property
    def y(self) -> Floats:
        return self._column(2)

    @property
    def way(self) -> Floats:
        return self._column(3)

    def _column(self, number: int) -> Floats:
        column: Floats = np.abs(np.array(self._rows)[:, number])
        return column


def drive(bench: Bench, points: Iterable[tuple[float, float]], *, speed: float = 400.0) -> Log:
    """Drive through points, turning on the spot where the way bends, and weaving a little on it."""
    log = Log()
    for x, y in points:
        while math.hypot(x - (at := bench.world.true_pose(0)).x_mm, y - at.y_mm) > 150.0:
            assert bench.t_ns < 600e9, f"stuck at {at}"
            bearing = math.degrees(math.atan2(at.x_mm - x, y - at.y_mm))
            off = math.remainder(bearing - at.heading_deg, 360.0)
            if abs(off) > 30.0:
                bench.frame(0.0, min(max(3.0 * off, -60.0), 60.0))
            else:
                bench.frame(speed, 2.0 * (off + 8.0 * math.sin(bench.t_ns / 1e9)))
            log.note(bench)
    return log


def with_doors_open(walls: Walls, part: float, seed: int, leaf_deg: float | None = None) -> Floats:
    """(n, 4): walls where some doors stand open into rooms 3 m deep, the leaf at 30 to 90 degrees."""
    random = np.random.default_rng(seed)
    segments: list[list[float]] = []
    for (x0, y0, x1, y1), kind in zip(walls.segments.tolist(), walls.kinds, strict=True):
        if kind is not EdgeKind.DOOR or random.random() >= part:
            segments.append([x0, y0, x1, y1])
            continue
        width = math.hypot(x1 - x0, y1 - y0)
        u, v = (x1 - x0) / width, (y1 - y0) / width
        angle = math.radians(random.uniform(30.0, 90.0) if leaf_deg is None else leaf_deg)
        ahead, inward = width * math.cos(angle), width * math.sin(angle)
        segments.append([x0, y0, x0 + ahead * u - inward * v, y0 + ahead * v + inward * u])
        a, b = (x0 - 0.2 * width * u, y0 - 0.2 * width * v), (x1 + 0.2 * width * u, y1 + 0.2 * width * v)
        deep_a, deep_b = ((x - 3000.0 * v, y + 3000.0 * u) for x, y in (a, b))
        corners = [(x0, y0), a, deep_a, deep_b, b, (x1, y1)]
        segments += [[*here, *there] for here, there in pairwise(corners)]
    return np.array(segments)
