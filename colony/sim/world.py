"""A building with robots in it: commands and time go in, sensor readings and poses come out.

The world does no I/O and has no clock: time passes when `World.advance` is called. All randomness comes from
one seed, through a generator a robot, so that the same calls give the same run bit for bit, and what a robot
draws depends neither on the other robots nor on which sensors are read.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colony.sim.base import SLICE_S, move
from colony.sim.config import CHANNELS, RobotConfig
from colony.sim.sonar import RAY_STEP_DEG, RayTable, corner_reflectors, sense, wall_table

MAX_STEP_S = 10.0
MAX_ROBOTS = 10_000


class Pose(NamedTuple):
    """x east and y north in mm, heading in degrees counterclockwise from north, in [0, 360)."""

    x_mm: float
    y_mm: float
    heading_deg: float


class Speed(NamedTuple):
    """How a base moves: ahead in mm/s (negative is backward), turning counterclockwise in degrees/s."""

    velocity_mm_s: float
    turn_deg_s: float


class Bumper(NamedTuple):
    """Which halves of the hull are touched."""

    front: bool
    rear: bool


class _Snapshot(NamedTuple):
    """The state of all robots, one row each."""

    poses: list[list[float]]
    odometry: list[list[float]]
    speeds: list[list[float]]
    contacts: list[list[bool]]


class World:
    """Robots of one kind among walls.

    Robots are numbered from 0 in the order of `poses`; they see and stop each other. A robot stands still
    until it is commanded, and keeps its last command.
    """

    def __init__(
        self,
        *,
        walls: ArrayLike,
        poses: Sequence[tuple[float, float, float]],
        config: RobotConfig | None = None,
        seed: int = 0,
    ) -> None:
        """Build a world.

        Args:
            walls: (n, 4), segments x0, y0, x1, y1 in mm; x is east and y north.
            poses: one (x, y, heading) a robot, in mm and degrees counterclockwise from north.
            config: what the robots are like; RoME by default.
            seed: where all randomness comes from.

        Raises:
            ValueError: shapes are wrong, numbers not finite, or a robot would overlap a wall or another one.
        """
        self.config = config or RobotConfig()
        self._walls = wall_table(_checked_walls(walls))
        self._poses = _checked_poses(poses)
        count = len(self._poses)
        self._check_room()
        self._odometry = self._poses.copy()
        self._speeds = np.zeros((count, 2))
        self._commands = np.zeros((count, 2))
        self._distances = np.zeros(count)
        self._contacts = np.zeros((count, 2), dtype=np.bool_)
        self._bumps = np.zeros(count, dtype=np.int64)
        self._generators = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(count)]
        errors = np.array([generator.standard_normal(2) for generator in self._generators])
        self._scales = 1.0 + self.config.wheel_scale * errors
        self._draws = np.empty((count, CHANNELS))
        self._draw(0)
        self._rays = RayTable.of(self.config)
        self._reflectors = corner_reflectors(self._walls)
        self._wired = np.zeros(CHANNELS, dtype=np.bool_)
        self._wired[list(self.config.infrared_wired)] = True
        self._deepest = np.empty(CHANNELS)
        self._depth = np.empty(self._rays.ray_u.shape)
        self._target = np.empty(self._rays.ray_u.shape, dtype=np.int64)
        self._echoes = np.empty((count, CHANNELS))
        self._axis_depths = np.empty((count, CHANNELS))
        self._wall_room = np.empty(len(self._walls), dtype=np.int64)
        self._robot_room = np.empty(count, dtype=np.int64)
        self._sonar = np.empty((count, CHANNELS))
        self._infrared = np.empty((count, CHANNELS), dtype=np.bool_)
        self._sensed = False
        self._snapshot: _Snapshot | None = None

    def __len__(self) -> int:
        """How many robots there are."""
        return len(self._poses)

    def command(self, robot: int, velocity_mm_s: float, turn_deg_s: float) -> None:
        """Set the speeds that a robot is to reach; they are clamped to what it can do.

        Raises:
            ValueError: a speed is not finite.
        """
        if not (math.isfinite(velocity_mm_s) and math.isfinite(turn_deg_s)):
            raise ValueError(f"the speeds are {velocity_mm_s} and {turn_deg_s}; expected finite ones")
        fastest, turn = self.config.max_velocity_mm_s, self.config.max_turn_deg_s
        robot = self._index(robot)
        self._commands[robot, 0] = min(max(velocity_mm_s, -fastest), fastest)
        self._commands[robot, 1] = min(max(turn_deg_s, -turn), turn)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass.

        Raises:
            ValueError: the time is not above 0, or beyond `MAX_STEP_S`.
        """
        if not 0.0 < dt_s <= MAX_STEP_S:
            raise ValueError(f"cannot advance by {dt_s} s; expected a time above 0, up to {MAX_STEP_S:g} s")
        config = self.config
        slices = math.ceil(dt_s / SLICE_S - 1e-9)
        self._draw(slices)
        slip = config.wheel_slip_mm / math.sqrt(1000.0)
        move(
            self._poses,
            self._odometry,
            self._speeds,
            self._commands,
            self._scales,
            self._draws,
            slices,
            self._walls,
            self._distances,
            dt_s,
            config.radius_mm,
            config.wheel_base_mm,
            config.acceleration_mm_s2,
            config.turn_acceleration_deg_s2,
            slip,
            self._wall_room,
            self._robot_room,
            self._contacts,
            self._bumps,
        )
        self._sensed = False
        self._snapshot = None

    def sonar(self, robot: int) -> NDArray[np.float64]:
        """What the sonars read, (24,) float64 in mm: 12 ahead, 18 left, 0 back, 6 right."""
        self._sense()
        readings: NDArray[np.float64] = self._sonar[self._index(robot)].copy()
        return readings

    def infrared(self, robot: int) -> NDArray[np.bool_]:
        """What the infrared detectors see, (24,) bool, numbered like the sonars."""
        self._sense()
        seen: NDArray[np.bool_] = self._infrared[self._index(robot)].copy()
        return seen

    def bumper(self, robot: int) -> Bumper:
        """Which halves of a robot's hull are touched by a wall or another robot."""
        return Bumper(*self._now().contacts[self._index(robot)])

    def bumps(self, robot: int) -> int:
        """How often a robot has run into something so far; a contact that lasts counts once."""
        return int(self._bumps[self._index(robot)])

    def distance(self, robot: int) -> float:
        """How far a robot has driven so far, forward and backward, in mm."""
        return float(self._distances[self._index(robot)])

    def speed(self, robot: int) -> Speed:
        """How fast a robot moves at the moment."""
        return Speed(*self._now().speeds[self._index(robot)])

    def true_pose(self, robot: int) -> Pose:
        """Where a robot really is."""
        return Pose(*self._now().poses[self._index(robot)])

    def odometry(self, robot: int) -> Pose:
        """Where a robot believes it is, by counting what its wheels turn; at first the true pose."""
        return Pose(*self._now().odometry[self._index(robot)])

    def set_odometry(self, robot: int, pose: tuple[float, float, float]) -> None:
        """Make a robot believe that it is at `pose`; it does not move.

        Raises:
            ValueError: a number is not finite.
        """
        self._odometry[self._index(robot)] = _checked_poses([pose])[0]
        self._snapshot = None

    def _index(self, robot: int) -> int:
        if not 0 <= robot < len(self._poses):
            raise IndexError(f"there is no robot {robot}; expected 0 to {len(self._poses) - 1}")
        return robot

    def _now(self) -> _Snapshot:
        """The present state as plain Python numbers, made once a step."""
        if self._snapshot is None:
            arrays = (self._poses, self._odometry, self._speeds, self._contacts)
            self._snapshot = _Snapshot(*(array.tolist() for array in arrays))
        return self._snapshot

    def _draw(self, slices: int) -> None:
        """Draw each robot's noise of one step: 24 numbers for its sonars, then two a slice for its wheels."""
        if self._draws.shape[1] != CHANNELS + 2 * slices:
            self._draws = np.empty((len(self._poses), CHANNELS + 2 * slices))
        for generator, row in zip(self._generators, self._draws, strict=True):
            generator.standard_normal(out=row)

    def _sense(self) -> None:
        if self._sensed:
            return
        config, rays = self.config, self._rays
        sense(
            self._poses,
            self._walls,
            self._reflectors,
            rays.origin_u,
            rays.origin_v,
            rays.ray_u,
            rays.ray_v,
            config.radius_mm,
            config.sonar_range_mm,
            math.radians(rays.half_beam_deg),
            math.cos(math.radians(config.sonar_critical_deg)),
            math.tan(math.radians(RAY_STEP_DEG / 2)),
            self._deepest,
            self._depth,
            self._target,
            self._echoes,
            self._axis_depths,
        )
        limit = config.sonar_range_mm
        deviation = config.sonar_noise_mm + config.sonar_noise * self._echoes
        noisy = self._echoes + self._draws[:, :CHANNELS] * deviation
        self._sonar = np.where(self._echoes < limit, np.clip(noisy, config.sonar_least_mm, limit), limit)
        self._infrared = (self._axis_depths <= config.infrared_range_mm) & self._wired
        self._sensed = True

    def _check_room(self) -> None:
        """Refuse robots that begin inside something."""
        radius = self.config.radius_mm
        for i, (x, y, _) in enumerate(self._poses):
            start, along = self._walls[:, :2] - (x, y), self._walls[:, 4:6]
            part = np.clip(-(start * along).sum(axis=1), 0.0, self._walls[:, 6])
            distances = np.hypot(*(start + part[:, None] * along).T)
            if (distances < radius).any():
                found = f"robot {i} at ({x:.0f}, {y:.0f}) is {distances.min():.0f} mm from a wall"
                raise ValueError(f"{found}; expected at least {radius:.0f} mm")
            apart = np.hypot(*(self._poses[:i, :2] - (x, y)).T)
            if (apart < 2 * radius).any():
                raise ValueError(f"robot {i} at ({x:.0f}, {y:.0f}) overlaps robot {int(apart.argmin())}")


def _checked_walls(walls: ArrayLike) -> NDArray[np.float64]:
    """A copy of the walls, without those that have no length."""
    checked = np.array(walls, dtype=np.float64, order="C")
    if checked.size == 0:
        return np.empty((0, 4))
    if checked.ndim != 2 or checked.shape[1] != 4:
        raise ValueError(f"walls have the shape {checked.shape}; expected (n, 4)")
    if not np.isfinite(checked).all():
        raise ValueError("a wall is not finite")
    return np.ascontiguousarray(checked[np.hypot(*(checked[:, 2:] - checked[:, :2]).T) > 0.0])


def _checked_poses(poses: Sequence[tuple[float, float, float]]) -> NDArray[np.float64]:
    checked = np.array(poses, dtype=np.float64)
    if checked.ndim != 2 or checked.shape[1] != 3 or len(checked) > MAX_ROBOTS:
        raise ValueError(
            f"the poses have the shape {checked.shape}; expected (n, 3), n from 1 to {MAX_ROBOTS}"
        )
    if not np.isfinite(checked).all():
        raise ValueError("a pose is not finite")
    checked[:, 2] %= 360.0
    return checked
