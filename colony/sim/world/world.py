"""A building with robots: commands and time are the input, sensor readings and poses the output.

The world has neither I/O nor a clock: `World.advance` advances time. All randomness comes from two seeds. The
world's seed is for the robots' own errors. Each robot has its own generator, so that the same calls give the
same run bit for bit, independent of other robots and of the sensors that are read. The scenery's seed is for
the hazards of the building (docs/hazards.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colony.nav.maps.stickrep.model import Pose
from colony.sim.chance import SEED_MODULUS
from colony.sim.config import RobotConfig, rome_config
from colony.sim.hazards.scenery import Scenery, bare_scenery
from colony.sim.noise import Noise
from colony.sim.sensors.compass import disturbance_deg
from colony.sim.sensors.sonar import CrossTalk, corner_reflectors, fan_of, proximity_model, sense, wall_table
from colony.sim.world.base import SLICE_S, Drivetrain, bases_at, move
from colony.sim.world.floor import floor_of, slip
from colony.sim.world.people import X, Y, crowd_of, make_way, walk
from colony.sim.world.placing import check_clearance, checked_poses, checked_walls

MAX_STEP_S = 10.0
SUBSTEP_S = 0.05
"""Largest time in seconds between two moves of people, or two checks for slips."""


class Speed(NamedTuple):
    """The speed of a base: ahead in mm/s (negative is backward), turning counterclockwise in degrees/s."""

    velocity_mm_s: float
    turn_deg_s: float


class Bumper(NamedTuple):
    """The bumpers of the two halves of the hull; True if pressed."""

    front: bool
    rear: bool


class _Snapshot(NamedTuple):
    """The state of all robots, one row each."""

    poses: list[list[float]]
    odometry: list[list[float]]
    speeds: list[list[float]]
    contacts: list[list[bool]]


class World:
    """Robots of one kind among walls, or in the scenery of a building.

    Robots are numbered from 0 in the order of `poses`; they detect and block each other. A robot stands still
    until its first command, and keeps its last one.
    """

    def __init__(
        self,
        *,
        walls: ArrayLike | Scenery,
        poses: Sequence[tuple[float, float, float]],
        config: RobotConfig | None = None,
        seed: int = 0,
    ) -> None:
        """Build a world.

        Args:
            walls: (n, 4), segments x0, y0, x1, y1 in mm; x is east and y north. Or a scenery, with its
                people, joints and other hazards.
            poses: one (x, y, heading) per robot, in mm and degrees counterclockwise from north. People at
                these positions are moved.
            config: the parameters of the robots; RoME by default.
            seed: seed of the robots' own errors.

        Raises:
            ValueError: a shape is wrong, a number is not finite, or a robot overlaps a wall or another robot.
        """
        self.config = config or rome_config()
        scenery = walls if isinstance(walls, Scenery) else bare_scenery(checked_walls(walls))
        initial_poses = checked_poses(poses)
        self._noise = Noise(len(initial_poses), seed)
        errors = self._noise.peek(2)
        self._bases = bases_at(
            initial_poses, scenery.encoder_scale * (1.0 + self.config.wheel_scale * errors)
        )
        self._crossings = np.zeros(len(initial_poses), dtype=np.int64)
        self._build(scenery.walls, scenery.silent)
        check_clearance(initial_poses, self._walls, self.config.radius_mm)
        self._set_scenery(scenery)
        self._steps = 0
        self._drivetrain = Drivetrain(
            radius=self.config.radius_mm,
            wheel_base=self.config.wheel_base_mm,
            acceleration=self.config.acceleration_mm_s2,
            turn_acceleration=self.config.turn_acceleration_deg_s2,
            slip=self.config.wheel_slip_mm / math.sqrt(1000.0),
        )
        self._proximity_model, self._fan = proximity_model(self.config), fan_of(self.config)
        channels = self.config.channels
        self._unwired = np.setdiff1d(np.arange(channels), self.config.infrared_wired)
        self._sonar = np.empty((len(initial_poses), channels))
        self._infrared = np.empty((len(initial_poses), channels), dtype=np.bool_)
        self._sonar_noise_column = self._noise.take(channels)
        self._sensed = False
        self._snapshot: _Snapshot | None = None

    def _build(self, walls: NDArray[np.float64], silent: NDArray[np.bool_]) -> None:
        has_length = np.hypot(*(walls[:, 2:] - walls[:, :2]).T) > 0.0
        self._walls = wall_table(walls[has_length])
        self._audible_walls = wall_table(walls[has_length & ~silent])
        self._reflectors = corner_reflectors(self._audible_walls)
        self._bases = self._bases._replace(wall_buffer=np.empty(len(self._walls), dtype=np.int64))

    def _set_scenery(self, scenery: Scenery) -> None:
        """Set everything in a scenery except its walls."""
        events = scenery.seed % SEED_MODULUS
        self._floor = floor_of(scenery.joints, scenery.slip, crossings=self._crossings, seed=events)
        self._crowd = crowd_of(scenery.people, seed=events)
        make_way(self._crowd, self._bases.poses)
        self._bases = self._bases._replace(person_buffer=np.empty(len(scenery.people), dtype=np.int64))
        self._has_events = bool(scenery.people or scenery.joints)
        self._cross_talk = CrossTalk(scenery.cross_talk, events)
        self._compass_disturbance = scenery.compass_disturbance

    def __len__(self) -> int:
        """Return the number of robots."""
        return len(self._bases.poses)

    def command(self, robot: int, velocity_mm_s: float, turn_deg_s: float) -> None:
        """Set the target speeds of a robot, clamped to its limits.

        Raises:
            ValueError: a speed is not finite.
        """
        if not (math.isfinite(velocity_mm_s) and math.isfinite(turn_deg_s)):
            raise ValueError(f"the speeds are {velocity_mm_s} and {turn_deg_s}; expected finite ones")
        max_velocity, max_turn = self.config.max_velocity_mm_s, self.config.max_turn_deg_s
        robot = self._index(robot)
        self._bases.commands[robot, 0] = min(max(velocity_mm_s, -max_velocity), max_velocity)
        self._bases.commands[robot, 1] = min(max(turn_deg_s, -max_turn), max_turn)

    def advance(self, dt_s: float) -> None:
        """Advance time by `dt_s` seconds.

        Raises:
            ValueError: the time is not above 0, or beyond `MAX_STEP_S`.
        """
        if not 0.0 < dt_s <= MAX_STEP_S:
            raise ValueError(f"cannot advance by {dt_s} s; expected a time above 0, up to {MAX_STEP_S:g} s")
        substeps = math.ceil(dt_s / SUBSTEP_S - 1e-9) if self._has_events else 1
        slices = math.ceil(dt_s / substeps / SLICE_S - 1e-9)
        noise_column = self._noise.take(self.config.channels + 2 * substeps * slices)
        self._sonar_noise_column = noise_column
        for substep in range(substeps):
            self._substep(dt_s / substeps, slices, noise_column + self.config.channels + 2 * substep * slices)
        self._steps += 1
        self._sensed = False
        self._snapshot = None

    def _substep(self, dt_s: float, slices: int, noise_column: int) -> None:
        """Move people, then robots, and then apply wheel slip."""
        bases, before = self._bases, None
        if self._has_events:
            before = bases.poses.copy()
            walk(self._crowd, bases.poses, self._drivetrain.radius, dt_s)
        move(bases, self._drivetrain, self._walls, self._crowd, self._noise.table, noise_column, slices, dt_s)
        if before is not None:
            slip(self._floor, before, bases.poses, bases.speeds, bases.odometry)

    def sonar(self, robot: int) -> NDArray[np.float64]:
        """Return the sonar readings, (channels,) float64 in mm, counterclockwise."""
        self._sense()
        readings: NDArray[np.float64] = self._sonar[self._index(robot)].copy()
        return readings

    def infrared(self, robot: int) -> NDArray[np.bool_]:
        """Return the infrared readings, (channels,) bool, numbered like the sonars."""
        self._sense()
        readings: NDArray[np.bool_] = self._infrared[self._index(robot)].copy()
        return readings

    def bumper(self, robot: int) -> Bumper:
        """Return the bumpers of a robot, pressed by walls, people or other robots."""
        return Bumper(*self._current_state().contacts[self._index(robot)])

    def bumps(self, robot: int) -> int:
        """Return the number of a robot's collisions so far; a contact that lasts counts once."""
        return int(self._bases.bumps[self._index(robot)])

    def contact_speed(self, robot: int) -> float:
        """Return the largest speed of a robot in its collisions so far, in mm/s.

        The speed is 0 without collisions.
        """
        return float(self._bases.impacts[self._index(robot)])

    def compass(self, robot: int) -> float:
        """Return the compass reading of a robot: its heading in degrees, in [0, 360).

        Iron in the building disturbs it (thesis Figure 6.2).
        """
        x, y, heading = self.true_pose(robot)
        return (heading + disturbance_deg(self._compass_disturbance, x, y)) % 360.0

    @property
    def walls(self) -> NDArray[np.float64]:
        """The current solid segments, (n, 7), from `wall_table`.

        Each change creates a new array, which must not be modified.
        """
        return self._walls

    @property
    def people(self) -> NDArray[np.float64]:
        """The positions of the people: a copy, (people, 2), x and y in mm of their centers."""
        return self._crowd.people[:, [X, Y]]

    def distance(self, robot: int) -> float:
        """Return the distance that a robot has driven so far, forward and backward, in mm."""
        return float(self._bases.distances[self._index(robot)])

    def speed(self, robot: int) -> Speed:
        """Return the current speed of a robot."""
        return Speed(*self._current_state().speeds[self._index(robot)])

    def wheel_speed(self, robot: int) -> float:
        """Return the mean magnitude of the speeds of both wheels, in mm/s."""
        speed = self.speed(robot)
        half = math.radians(speed.turn_deg_s) * self.config.wheel_base_mm / 2.0
        return (abs(speed.velocity_mm_s - half) + abs(speed.velocity_mm_s + half)) / 2.0

    def true_pose(self, robot: int) -> Pose:
        """Return the true pose of a robot."""
        return Pose(*self._current_state().poses[self._index(robot)])

    def odometry(self, robot: int) -> Pose:
        """Return the pose of a robot according to its odometry, initially the true pose."""
        return Pose(*self._current_state().odometry[self._index(robot)])

    def set_odometry(self, robot: int, pose: tuple[float, float, float]) -> None:
        """Set the odometry of a robot to `pose`, without moving it.

        Raises:
            ValueError: a number is not finite.
        """
        self._bases.odometry[self._index(robot)] = checked_poses([pose])[0]
        self._snapshot = None

    @property
    def true_poses(self) -> NDArray[np.float64]:
        """The true poses of all robots: a copy, (robots, 3), x and y in mm, heading in degrees."""
        return self._bases.poses.copy()

    def place(self, robot: int, pose: tuple[float, float, float]) -> None:
        """Move a robot to `pose`, where it stands still, unnoticed by its odometry.

        People at that position are moved.

        Raises:
            ValueError: a number is not finite, or the robot would overlap a wall or another robot.
        """
        robot = self._index(robot)
        poses = self._bases.poses.copy()
        poses[robot] = checked_poses([pose])[0]
        check_clearance(poses, self._walls, self.config.radius_mm)
        make_way(self._crowd, poses, robot=robot)
        self._bases.poses[robot] = poses[robot]
        self._bases.speeds[robot] = 0.0
        self._sensed = False
        self._snapshot = None

    def rebuild(self, walls: NDArray[np.float64], silent: NDArray[np.bool_]) -> None:
        """Replace all walls by others, (n, 4) in mm; `silent` is a mask of walls that sensors do not detect.

        Everything else stays the same. A robot inside a new wall can move out of it, but not farther in.
        """
        self._build(walls, silent)
        self._sensed = False

    def enter(self, scenery: Scenery, poses: Sequence[tuple[float, float, float]]) -> None:
        """Move all robots to another scenery, where they stand still at `poses`.

        The move is unnoticed by their odometry, and their encoders keep their errors.

        Raises:
            ValueError: there is not one pose per robot, or a robot does not fit at its pose; then nothing has
                changed.
        """
        new_poses = checked_poses(poses)
        if len(new_poses) != len(self):
            raise ValueError(f"found {len(new_poses)} poses; expected one for each robot, {len(self)}")
        solid = scenery.walls[np.hypot(*(scenery.walls[:, 2:] - scenery.walls[:, :2]).T) > 0.0]
        check_clearance(new_poses, wall_table(solid), self.config.radius_mm)
        self._bases.poses[:] = new_poses
        self._bases.speeds[:] = 0.0
        self._build(scenery.walls, scenery.silent)
        self._set_scenery(scenery)
        self._sensed = False
        self._snapshot = None

    def _index(self, robot: int) -> int:
        if not 0 <= robot < len(self._bases.poses):
            raise IndexError(f"no robot {robot}; expected 0 to {len(self._bases.poses) - 1}")
        return robot

    def _current_state(self) -> _Snapshot:
        """Return the current state as plain Python numbers, converted once per step."""
        if self._snapshot is None:
            arrays = (self._bases.poses, self._bases.odometry, self._bases.speeds, self._bases.contacts)
            self._snapshot = _Snapshot(*(array.tolist() for array in arrays))
        return self._snapshot

    def _sense(self) -> None:
        if not self._sensed:
            sense(
                self._bases.poses,
                self._audible_walls,
                self._reflectors,
                self._crowd,
                self._proximity_model,
                self._cross_talk,
                self._steps,
                self._fan,
                self._noise.table,
                self._sonar_noise_column,
                self._sonar,
                self._infrared,
            )
            self._infrared[:, self._unwired] = False
            self._sensed = True
