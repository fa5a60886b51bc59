"""A robot below the lights of a straight corridor, by plain geometry, for the tests of CTracker.

It moves as the test says, whatever is commanded; its odometry has the errors that the test says. What
CTracker asks is answered by the local servers of the experiments, and by a base and cameras that are made
here. Of images only the scan lines are rendered: the other rows are black.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from colony.nav.shared import (
    CEILING_LIGHT,
    END_L_MODE,
    GOAL_DIRECTION,
    GOAL_DISTANCE,
    LIGHT_OFFSET,
    OVERSHOOT,
    TRACK_DATA,
)
from colony.runtime.assembly.loop import LocalCamera
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.library import data, robot
from colony.runtime.protocol.calls import CallId, RefusedError
from colony.runtime.protocol.images import Image
from colony.vision.lights.ceiling_camera import UPWARD, CeilingCameraModel
from tests.kit.script_stage import ASKED, FRAME_NS, ScriptStage, Server, Shutter

FRAME_S = FRAME_NS / 1e9
_SAMPLES = 4  # a pixel


@dataclass(frozen=True, slots=True, kw_only=True)
class Ceiling:
    """Gray levels of a corridor's ceiling; `lights` are the places of their centers along it, with their
    levels, `bands` where it is in the sun: from, to, level."""

    lights: tuple[tuple[float, float], ...] = ()
    level: float = 80.0
    bands: tuple[tuple[float, float, float], ...] = ()
    noise: float = 3.0
    vignetting: float = 0.25


def rendered(
    ceiling: Ceiling,
    rng: np.random.Generator,
    *,
    along_mm: float,
    left_mm: float = 0.0,
    tilt_deg: float = 0.0,
    camera: CeilingCameraModel = UPWARD,
) -> NDArray[np.uint8]:
    """The scan lines of a camera that is so far along a corridor, to the left of its middle, and tilted."""
    columns = (np.arange(camera.columns * _SAMPLES) + 0.5) / _SAMPLES - 0.5
    ahead = camera.ahead_of(0.0) + camera.mm_per_column * columns
    tilt = math.radians(tilt_deg)
    lines = []
    for row in camera.scan_rows:
        left = camera.left_of(row)
        along = along_mm + ahead * math.cos(tilt) - left * math.sin(tilt)
        across = left_mm + ahead * math.sin(tilt) + left * math.cos(tilt)
        line = np.full(len(columns), ceiling.level)
        for first, last, level in ceiling.bands:
            line[(along > first) & (along < last)] = level
        for place, level in ceiling.lights:
            line[(abs(along - place) < 300.0) & (abs(across) < 600.0)] = level
        from_middle = (columns / camera.columns - 0.5) ** 2 + (row / camera.rows - 0.5) ** 2
        line *= 1.0 - 2.0 * ceiling.vignetting * from_middle
        lines.append(line.reshape(-1, _SAMPLES).mean(axis=1))
    noisy = np.array(lines) + rng.normal(0.0, ceiling.noise, (len(lines), camera.columns))
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """How a robot goes along a corridor, north: at `speed` along it from `along_mm`, `left_mm` of its middle,
    tilted by `tilt_deg`. Its odometry says `scale` times what it goes, from `off_mm` too far on, and that its
    heading is `believed_deg`. At `slips` (place, mm) wheels spin, so that it reports what it does not go; at
    `stands` (place, seconds) it stands for so long. Between the places of `silent` RServer refuses to give
    the position."""

    speed: float = 300.0
    along_mm: float = 0.0
    left_mm: float = 0.0
    tilt_deg: float = 0.0
    believed_deg: float = 0.0
    scale: float = 1.0
    off_mm: float = 0.0
    slips: tuple[tuple[float, float], ...] = ()
    stands: tuple[tuple[float, float], ...] = ()
    silent: tuple[float, float] = (math.inf, math.inf)


class Base(Server):
    """RServer of the robot. Mutable: where it is, and where it is believed to be; what was corrected."""

    def __init__(self, moves: Robot) -> None:
        super().__init__("RServer", {"position": self._position, "adjust_position": self._adjust})
        self._moves = moves
        self.along_mm = moves.along_mm
        self.x, self.y, self.heading = 0.0, moves.along_mm + moves.off_mm, moves.believed_deg
        self.corrections: list[tuple[float, float, float]] = []
        self._slips, self._stands = list(moves.slips), list(moves.stands)

    def advance(self) -> None:
        """Go on for a frame."""
        if self._stands and self.along_mm >= self._stands[0][0]:
            place, seconds = self._stands[0]
            self._stands[0] = (place, seconds - FRAME_S)
            if seconds - FRAME_S <= 0.0:
                self._stands.pop(0)
            return
        way = self._moves.speed * FRAME_S
        self.along_mm += way
        self.y += self._moves.scale * way
        if self._slips and self.along_mm >= self._slips[0][0]:
            self.y += self._slips.pop(0)[1]

    def _position(self, asked: CallId, arguments: Any, now_ns: int) -> robot.Position:
        if self._moves.silent[0] <= self.along_mm < self._moves.silent[1]:
            raise RefusedError("no value", "the base does not answer")
        return robot.Position(x=self.x, y=self.y, heading=self.heading % 360.0, t_ns=now_ns)

    def _adjust(self, asked: CallId, arguments: robot.PoseArguments, now_ns: int) -> None:
        self.corrections.append((arguments.x, arguments.y, arguments.heading))
        self.x, self.y = self.x + arguments.x, self.y + arguments.y
        self.heading += arguments.heading


@dataclass(frozen=False, slots=True, kw_only=True)
class Log:
    """What happened: (true place, CeilingLight) at every change, the Overshoot of every goal with the true
    place then, and the true place less what RServer says, at every frame."""

    counts: list[tuple[float, int]] = field(default_factory=list)
    overshoots: list[tuple[float, float]] = field(default_factory=list)
    errors_mm: list[float] = field(default_factory=list)


class Stage(ScriptStage):
    """A robot in a corridor, and scripts, one of which gives the goals: the places of the lights to pass, one
    goal after the other, and each as soon as the one before was done, or after `patience_s`. `cameras` are
    where the robot has them, by name. `lights` is a wrong number of lights to set.
    """

    def __init__(
        self,
        ceiling: Ceiling,
        moves: Robot,
        scripts: Mapping[str, Script],
        *,
        seed: int,
        goals: Sequence[Sequence[float]],
        cameras: Mapping[str, CeilingCameraModel] | None = None,
        patience_s: float | None = None,
        lights: int | None = None,
    ) -> None:
        self._patience_s, self._lights = patience_s, lights
        self._rng = np.random.default_rng(seed)
        self._ceiling, self._moves = ceiling, moves
        self.base = Base(moves)
        self.log = Log()
        eyes = [
            LocalCamera(name, Shutter(partial(self._image, geometry)))
            for name, geometry in (cameras or {"CServerUp": UPWARD}).items()
        ]
        super().__init__({**scripts, "planner": self._planner(goals)}, self.base, cameras=eyes)

    def camera_period_s(self, name: str) -> float:
        """How often a camera takes an image."""
        (camera,) = (camera for camera in self._cameras if camera.address == name)
        period_ns = camera.handlers["period"](ASKED, None, 0)
        assert isinstance(period_ns, int)
        return period_ns / 1e9

    def run(self, seconds: float, *, all_of_it: bool = False) -> Log:
        """Until all goals are done, or for so long; for so long in any case with `all_of_it`."""
        for _ in range(round(seconds / FRAME_S)):
            self.now_ns += FRAME_NS
            self.base.advance()
            self.settle()
            self.log.errors_mm.append(self.base.along_mm - self.base.y)
            count = self.told(CEILING_LIGHT)
            if count is not None and (not self.log.counts or count != self.log.counts[-1][1]):
                self.log.counts.append((self.base.along_mm, count))
            if self.scripts.has_ended("planner") and not all_of_it:
                break
        return self.log

    def _planner(self, goals: Sequence[Sequence[float]]) -> Script:
        for name in (TRACK_DATA, END_L_MODE):
            yield from do("DServer", data.create_semaphore(name, 0))
        for places in goals:
            yield from sleep(0.2)
            here = yield from do("RServer", robot.position())
            offsets = [b - a for a, b in zip([here.y, *places], places, strict=False)]
            count = len(places) if self._lights is None else self._lights
            goal = {GOAL_DISTANCE: count, GOAL_DIRECTION: 0.0, LIGHT_OFFSET: offsets}
            yield from do("DServer", data.set_many(goal))
            yield from do("DServer", data.signal(TRACK_DATA))
            try:
                yield from do("DServer", data.wait(END_L_MODE, timeout_s=self._patience_s))
            except CallRefusedError:
                self._patience_s = None
                continue
            over = yield from do("DServer", data.get(OVERSHOOT, type=float))
            self.log.overshoots.append((self.base.along_mm, over))

    def _image(self, geometry: CeilingCameraModel) -> Image:
        """Mounted to the left, a camera is where a robot further to the left would have it."""
        at = replace(geometry, left_mm=0.0, ahead_mm=0.0)
        lines = rendered(
            self._ceiling,
            self._rng,
            along_mm=self.base.along_mm + geometry.ahead_mm,
            left_mm=self._moves.left_mm + geometry.left_mm,
            tilt_deg=self._moves.tilt_deg,
            camera=at,
        )
        pixels = np.zeros((geometry.rows, geometry.columns), dtype=np.uint8)
        pixels[list(geometry.scan_rows)] = lines
        return Image(
            t_ns=self.now_ns,
            height=geometry.rows,
            width=geometry.columns,
            channels=1,
            pixels=pixels.tobytes(),
        )
