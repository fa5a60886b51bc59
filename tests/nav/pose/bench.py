"""A robot in the simulator that runs one script, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.stickrep.model import EdgeKind
from colony.nav.maps.walls import Walls
from colony.runtime.arbitration.motion import OdometerPose
from colony.runtime.assembly.loop import LocalServer
from colony.runtime.kit.script import Script
from colony.runtime.library.proximity import SonarReading
from colony.runtime.library.robot import PoseArguments
from colony.runtime.protocol.calls import CallId
from colony.runtime.servers.base import Base
from colony.sim.drivers import Plant, SimulatedBase
from colony.sim.world.world import World
from tests.kit.script_stage import ASKED, FRAME_NS, ScriptStage, Server

Floats = NDArray[np.float64]


class Bench(ScriptStage):
    """One robot of a world, its base and sonars, and one script."""

    def __init__(
        self, world: World, script: Script, *, cross_talk: float = 0.0, seed: int = 0, lag: bool = False
    ) -> None:
        """`lag`: the sonars give what they read a frame ago."""
        self.world, self.adjusted = world, 0
        self._cross_talk, self._random = cross_talk, np.random.default_rng(seed)
        self._base = Base(SimulatedBase(Plant(world, lambda: self.now_ns), 0))
        server = LocalServer("RServer", self._base.methods)
        self._adjust = server.handlers["adjust_position"]
        server.handlers = {**server.handlers, "adjust_position": self._counted}
        ring = Server("PServer", {"sonar": lambda *_: self._scans[0 if lag else 1]})
        super().__init__({"script": script}, server, ring)
        self._base.refresh()
        self._scans = [self._scan()] * 2

    @property
    def believed(self) -> OdometerPose:
        """Where RServer says that the robot is."""
        self._base.refresh()
        return self._base.pose

    @property
    def heading_error_deg(self) -> float:
        return math.remainder(self.believed.heading - self.world.true_pose(0).heading_deg, 360.0)

    @property
    def position_error_mm(self) -> tuple[float, float]:
        true = self.world.true_pose(0)
        return self.believed.x - true.x_mm, self.believed.y - true.y_mm

    def adjust(self, dx: float, dy: float, dheading: float) -> None:
        """Adjust the position as another client."""
        self._adjust(ASKED, PoseArguments(x=dx, y=dy, heading=dheading), self.now_ns)

    def slip(self, turn_deg: float, back_mm: float = 0.0) -> None:
        """Turn and set back the robot without its odometry noticing."""
        x, y, heading = self.world.true_pose(0)
        angle = math.radians(heading)
        place = (x + back_mm * math.sin(angle), y - back_mm * math.cos(angle), heading + turn_deg)
        self.world.place(0, place)

    def frame(self, velocity: float, turn: float) -> None:
        """Drive for a frame, and let the script go on."""
        self.world.command(0, velocity, turn)
        self.now_ns += FRAME_NS
        self._base.refresh()
        self._scans = [self._scans[-1], self._scan()]
        self.settle()

    def _counted(self, asked: CallId, arguments: PoseArguments, now_ns: int) -> object:
        self.adjusted += 1
        return self._adjust(asked, arguments, now_ns)

    def _scan(self) -> SonarReading:
        ranges = self.world.sonar(0)
        if self._cross_talk:
            false = self._random.random(len(ranges)) < self._cross_talk
            ranges = np.where(false, self._random.uniform(300.0, np.maximum(ranges, 301.0)), ranges)
        return SonarReading(t_ns=self.now_ns, ranges=tuple(ranges.tolist()))


class Log:
    """How far off the robot believes itself to be, frame by frame, in absolute values: its heading, x and y;
    and the way so far."""

    def __init__(self, rows: Sequence[tuple[float, float, float, float]]) -> None:
        self.heading, self.x, self.y, self.way = np.abs(np.array(rows)).T


def drive(bench: Bench, points: Iterable[tuple[float, float]], *, speed: float = 400.0) -> Log:
    """Drive through points, turning on the spot where the way bends, and weaving a little on it."""
    rows = []
    for x, y in points:
        while math.hypot(x - (at := bench.world.true_pose(0)).x_mm, y - at.y_mm) > 150.0:
            assert bench.now_ns < 600e9, f"stuck at {at}"
            bearing = math.degrees(math.atan2(at.x_mm - x, y - at.y_mm))
            off = math.remainder(bearing - at.heading_deg, 360.0)
            if abs(off) > 30.0:
                bench.frame(0.0, min(max(3.0 * off, -60.0), 60.0))
            else:
                bench.frame(speed, 2.0 * (off + 8.0 * math.sin(bench.now_ns / 1e9)))
            rows.append((bench.heading_error_deg, *bench.position_error_mm, bench.world.distance(0)))
    return Log(rows)


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
