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

from colony.sim.base import SLICE_S, Bases, Drive, move
from colony.sim.config import CHANNELS, RobotConfig
from colony.sim.sonar import corner_reflectors, ears_of, fan_of, sense, wall_table

MAX_STEP_S = 10.0
MAX_ROBOTS = 10_000
_NOISE_BLOCK = 512


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
        self._reflectors = corner_reflectors(self._walls)
        places = _checked_poses(poses)
        count = len(places)
        _check_room(places, self._walls, self.config.radius_mm)
        self._generators = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(count)]
        errors = np.array([generator.standard_normal(2) for generator in self._generators])
        self._noise = np.empty((count, 0))
        self._noise_at = 0
        self._bases = Bases(
            poses=places,
            odometry=places.copy(),
            speeds=np.zeros((count, 2)),
            commands=np.zeros((count, 2)),
            scales=1.0 + self.config.wheel_scale * errors,
            distances=np.zeros(count),
            contacts=np.zeros((count, 2), dtype=np.bool_),
            bumps=np.zeros(count, dtype=np.int64),
            wall_room=np.empty(len(self._walls), dtype=np.int64),
            robot_room=np.empty(count, dtype=np.int64),
        )
        self._drive = Drive(
            radius=self.config.radius_mm,
            wheel_base=self.config.wheel_base_mm,
            acceleration=self.config.acceleration_mm_s2,
            turn_acceleration=self.config.turn_acceleration_deg_s2,
            slip=self.config.wheel_slip_mm / math.sqrt(1000.0),
        )
        self._ears, self._fan = ears_of(self.config), fan_of(self.config)
        self._unwired = np.setdiff1d(np.arange(CHANNELS), self.config.infrared_wired)
        self._sonar = np.empty((count, CHANNELS))
        self._infrared = np.empty((count, CHANNELS), dtype=np.bool_)
        self._sonar_noise_at = self._draw(CHANNELS)
        self._sensed = False
        self._snapshot: _Snapshot | None = None

    def __len__(self) -> int:
        """How many robots there are."""
        return len(self._bases.poses)

    def command(self, robot: int, velocity_mm_s: float, turn_deg_s: float) -> None:
        """Set the speeds that a robot is to reach; they are clamped to what it can do.

        Raises:
            ValueError: a speed is not finite.
        """
        if not (math.isfinite(velocity_mm_s) and math.isfinite(turn_deg_s)):
            raise ValueError(f"the speeds are {velocity_mm_s} and {turn_deg_s}; expected finite ones")
        fastest, turn = self.config.max_velocity_mm_s, self.config.max_turn_deg_s
        robot = self._index(robot)
        self._bases.commands[robot, 0] = min(max(velocity_mm_s, -fastest), fastest)
        self._bases.commands[robot, 1] = min(max(turn_deg_s, -turn), turn)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass.

        Raises:
            ValueError: the time is not above 0, or beyond `MAX_STEP_S`.
        """
        if not 0.0 < dt_s <= MAX_STEP_S:
            raise ValueError(f"cannot advance by {dt_s} s; expected a time above 0, up to {MAX_STEP_S:g} s")
        slices = math.ceil(dt_s / SLICE_S - 1e-9)
        at = self._draw(CHANNELS + 2 * slices)
        self._sonar_noise_at = at
        move(self._bases, self._drive, self._walls, self._noise, at + CHANNELS, slices, dt_s)
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
        return int(self._bases.bumps[self._index(robot)])

    def distance(self, robot: int) -> float:
        """How far a robot has driven so far, forward and backward, in mm."""
        return float(self._bases.distances[self._index(robot)])

    def speed(self, robot: int) -> Speed:
        """How fast a robot moves at the moment."""
        return Speed(*self._now().speeds[self._index(robot)])

    def wheel_speed(self, robot: int) -> float:
        """The mean magnitude of the speeds of both wheels, in mm/s."""
        speed = self.speed(robot)
        half = math.radians(speed.turn_deg_s) * self.config.wheel_base_mm / 2.0
        return (abs(speed.velocity_mm_s - half) + abs(speed.velocity_mm_s + half)) / 2.0

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
        self._bases.odometry[self._index(robot)] = _checked_poses([pose])[0]
        self._snapshot = None

    @property
    def true_poses(self) -> NDArray[np.float64]:
        """Where all robots really are: a copy, (robots, 3), x and y in mm, heading in degrees."""
        return self._bases.poses.copy()

    def place(self, robot: int, pose: tuple[float, float, float]) -> None:
        """Carry a robot to `pose` and put it down there, standing; its odometry does not notice.

        Raises:
            ValueError: a number is not finite, or the robot would overlap a wall or another robot.
        """
        robot = self._index(robot)
        poses = self._bases.poses.copy()
        poses[robot] = _checked_poses([pose])[0]
        _check_room(poses, self._walls, self.config.radius_mm)
        self._bases.poses[robot] = poses[robot]
        self._bases.speeds[robot] = 0.0
        self._sensed = False
        self._snapshot = None

    def _index(self, robot: int) -> int:
        if not 0 <= robot < len(self._bases.poses):
            raise IndexError(f"there is no robot {robot}; expected 0 to {len(self._bases.poses) - 1}")
        return robot

    def _now(self) -> _Snapshot:
        """The present state as plain Python numbers, made once a step."""
        if self._snapshot is None:
            arrays = (self._bases.poses, self._bases.odometry, self._bases.speeds, self._bases.contacts)
            self._snapshot = _Snapshot(*(array.tolist() for array in arrays))
        return self._snapshot

    def _draw(self, count: int) -> int:
        """Take `count` numbers from each robot's stream of noise; gives their first column in `_noise`.

        The streams are drawn ahead in blocks; where these begin and end makes no difference.
        """
        if self._noise_at + count > self._noise.shape[1]:
            rest = self._noise[:, self._noise_at :]
            block = np.empty((len(self._generators), max(_NOISE_BLOCK, count)))
            block[:, : rest.shape[1]] = rest
            for generator, row in zip(self._generators, block, strict=True):
                generator.standard_normal(out=row[rest.shape[1] :])
            self._noise, self._noise_at = block, 0
        self._noise_at += count
        return self._noise_at - count

    def _sense(self) -> None:
        if not self._sensed:
            sense(
                self._bases.poses,
                self._walls,
                self._reflectors,
                self._ears,
                self._fan,
                self._noise,
                self._sonar_noise_at,
                self._sonar,
                self._infrared,
            )
            self._infrared[:, self._unwired] = False
            self._sensed = True


def _check_room(poses: NDArray[np.float64], walls: NDArray[np.float64], radius: float) -> None:
    """Refuse robots that begin inside a wall or another robot."""
    for i, (x, y, _) in enumerate(poses):
        start, along = walls[:, :2] - (x, y), walls[:, 4:6]
        part = np.clip(-(start * along).sum(axis=1), 0.0, walls[:, 6])
        distances = np.hypot(*(start + part[:, None] * along).T)
        if (distances < radius).any():
            found = f"robot {i} at ({x:.0f}, {y:.0f}) is {distances.min():.0f} mm from a wall"
            raise ValueError(f"{found}; expected at least {radius:.0f} mm")
        apart = np.hypot(*(poses[:i, :2] - (x, y)).T)
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
