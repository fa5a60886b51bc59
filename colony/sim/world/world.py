"""A building with robots in it: commands and time go in, sensor readings and poses come out.

The world does no I/O and has no clock: time passes when `World.advance` is called. All randomness comes from
two seeds. That of the world is for the robots' own errors, through a generator a robot, so that the same
calls give the same run bit for bit, and what a robot draws depends neither on the other robots nor on which
sensors are read. That of a scenery is for what goes wrong in the building (docs/hazards.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colony.nav.maps.stickrep.model import Pose
from colony.sim.chance import SEEDS
from colony.sim.config import CHANNELS, RobotConfig
from colony.sim.hazards.scenery import Scenery, bare
from colony.sim.noise import Noise
from colony.sim.sensors.compass import disturbance_deg
from colony.sim.sensors.sonar import Talk, corner_reflectors, ears_of, fan_of, sense, wall_table
from colony.sim.world.base import SLICE_S, Drivetrain, bases_at, move
from colony.sim.world.floor import floor_of, slip
from colony.sim.world.people import X, Y, crowd_of, make_way, walk
from colony.sim.world.placing import check_room, checked_poses, checked_walls

MAX_STEP_S = 10.0
TURN_S = 0.05
"""Longest time between two moves of people, or two checks for slips."""


class Speed(NamedTuple):
    """The speed of a base: ahead in mm/s (negative is backward), turning counterclockwise in degrees/s."""

    velocity_mm_s: float
    turn_deg_s: float


class Bumper(NamedTuple):
    """The halves of the hull that are touched."""

    front: bool
    rear: bool


class _Snapshot(NamedTuple):
    """The state of all robots, one row each."""

    poses: list[list[float]]
    odometry: list[list[float]]
    speeds: list[list[float]]
    contacts: list[list[bool]]


class World:
    """Robots of one kind among walls, or in a building as it is in one run.

    Robots are numbered from 0 in the order of `poses`; they see and stop each other. A robot stands still
    until it is commanded, and keeps its last command.
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
            walls: (n, 4), segments x0, y0, x1, y1 in mm; x is east and y north. Or a building in one run,
                with its people, joints and whatever else goes wrong in it.
            poses: one (x, y, heading) a robot, in mm and degrees counterclockwise from north. People who
                stand there begin elsewhere.
            config: the parameters of the robots; RoME by default.
            seed: where the randomness of the robots' own errors comes from.

        Raises:
            ValueError: shapes are wrong, numbers not finite, or a robot would overlap a wall or another one.
        """
        self.config = config or RobotConfig()
        scenery = walls if isinstance(walls, Scenery) else bare(checked_walls(walls))
        places = checked_poses(poses)
        self._noise = Noise(len(places), seed)
        errors = self._noise.first(2)
        self._bases = bases_at(places, scenery.encoder_scale * (1.0 + self.config.wheel_scale * errors))
        self._crossings = np.zeros(len(places), dtype=np.int64)
        self._build(scenery.walls, scenery.silent)
        check_room(places, self._walls, self.config.radius_mm)
        self._furnish(scenery)
        self._steps = 0
        self._drive = Drivetrain(
            radius=self.config.radius_mm,
            wheel_base=self.config.wheel_base_mm,
            acceleration=self.config.acceleration_mm_s2,
            turn_acceleration=self.config.turn_acceleration_deg_s2,
            slip=self.config.wheel_slip_mm / math.sqrt(1000.0),
        )
        self._ears, self._fan = ears_of(self.config), fan_of(self.config)
        self._unwired = np.setdiff1d(np.arange(CHANNELS), self.config.infrared_wired)
        self._sonar = np.empty((len(places), CHANNELS))
        self._infrared = np.empty((len(places), CHANNELS), dtype=np.bool_)
        self._sonar_noise_at = self._noise.take(CHANNELS)
        self._sensed = False
        self._snapshot: _Snapshot | None = None

    def _build(self, walls: NDArray[np.float64], silent: NDArray[np.bool_]) -> None:
        has_length = np.hypot(*(walls[:, 2:] - walls[:, :2]).T) > 0.0
        self._walls = wall_table(walls[has_length])
        self._heard = wall_table(walls[has_length & ~silent])
        self._reflectors = corner_reflectors(self._heard)
        self._bases = self._bases._replace(wall_room=np.empty(len(self._walls), dtype=np.int64))

    def _furnish(self, scenery: Scenery) -> None:
        """Put there what a building has besides walls."""
        events = scenery.seed % SEEDS
        self._floor = floor_of(scenery.joints, scenery.slip, crossings=self._crossings, seed=events)
        self._crowd = crowd_of(scenery.people, seed=events)
        make_way(self._crowd, self._bases.poses)
        self._bases = self._bases._replace(person_room=np.empty(len(scenery.people), dtype=np.int64))
        self._eventful = bool(scenery.people or scenery.joints)
        self._talk = Talk(scenery.cross_talk, events)
        self._iron = scenery.iron

    def __len__(self) -> int:
        """Return the number of robots."""
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
        turns = math.ceil(dt_s / TURN_S - 1e-9) if self._eventful else 1
        slices = math.ceil(dt_s / turns / SLICE_S - 1e-9)
        at = self._noise.take(CHANNELS + 2 * turns * slices)
        self._sonar_noise_at = at
        for turn in range(turns):
            self._turn(dt_s / turns, slices, at + CHANNELS + 2 * turn * slices)
        self._steps += 1
        self._sensed = False
        self._snapshot = None

    def _turn(self, dt_s: float, slices: int, noise_at: int) -> None:
        """Let people walk, then robots drive, then their wheels slip."""
        bases, before = self._bases, None
        if self._eventful:
            before = bases.poses.copy()
            walk(self._crowd, bases.poses, self._drive.radius, dt_s)
        move(bases, self._drive, self._walls, self._crowd, self._noise.table, noise_at, slices, dt_s)
        if before is not None:
            slip(self._floor, before, bases.poses, bases.speeds, bases.odometry)

    def sonar(self, robot: int) -> NDArray[np.float64]:
        """Return the sonar readings, (24,) float64 in mm: 12 ahead, 18 left, 0 back, 6 right."""
        self._sense()
        readings: NDArray[np.float64] = self._sonar[self._index(robot)].copy()
        return readings

    def infrared(self, robot: int) -> NDArray[np.bool_]:
        """Return the infrared readings, (24,) bool, numbered like the sonars."""
        self._sense()
        seen: NDArray[np.bool_] = self._infrared[self._index(robot)].copy()
        return seen

    def bumper(self, robot: int) -> Bumper:
        """Return which halves of a robot's hull are touched by a wall, a person or another robot."""
        return Bumper(*self._now().contacts[self._index(robot)])

    def bumps(self, robot: int) -> int:
        """Return the number of a robot's collisions so far; a contact that lasts counts once."""
        return int(self._bases.bumps[self._index(robot)])

    def contact_speed(self, robot: int) -> float:
        """Return the speed of a robot itself in its collisions so far, in mm/s: the largest of them.

        0 if it has touched nothing.
        """
        return float(self._bases.impacts[self._index(robot)])

    def compass(self, robot: int) -> float:
        """Return the compass reading of a robot: its heading in degrees, in [0, 360).

        Iron where the robot stands disturbs it (thesis Figure 6.2).
        """
        x, y, heading = self.true_pose(robot)
        return (heading + disturbance_deg(self._iron, x, y)) % 360.0

    @property
    def walls(self) -> NDArray[np.float64]:
        """Solid segments at the moment, (n, 7) as `wall_table` gives them.

        It is another array after each change, and must not be written to.
        """
        return self._walls

    @property
    def people(self) -> NDArray[np.float64]:
        """Places of the people: a copy, (people, 2), x and y in mm of their middles."""
        return self._crowd.places[:, [X, Y]]

    def distance(self, robot: int) -> float:
        """Return the distance that a robot has driven so far, forward and backward, in mm."""
        return float(self._bases.distances[self._index(robot)])

    def speed(self, robot: int) -> Speed:
        """Return the present speed of a robot."""
        return Speed(*self._now().speeds[self._index(robot)])

    def wheel_speed(self, robot: int) -> float:
        """Return the mean magnitude of the speeds of both wheels, in mm/s."""
        speed = self.speed(robot)
        half = math.radians(speed.turn_deg_s) * self.config.wheel_base_mm / 2.0
        return (abs(speed.velocity_mm_s - half) + abs(speed.velocity_mm_s + half)) / 2.0

    def true_pose(self, robot: int) -> Pose:
        """Return the true pose of a robot."""
        return Pose(*self._now().poses[self._index(robot)])

    def odometry(self, robot: int) -> Pose:
        """Return the pose of a robot by its wheels' odometry; at first the true pose."""
        return Pose(*self._now().odometry[self._index(robot)])

    def set_odometry(self, robot: int, pose: tuple[float, float, float]) -> None:
        """Make a robot believe that it is at `pose`; it does not move.

        Raises:
            ValueError: a number is not finite.
        """
        self._bases.odometry[self._index(robot)] = checked_poses([pose])[0]
        self._snapshot = None

    @property
    def true_poses(self) -> NDArray[np.float64]:
        """True poses of all robots: a copy, (robots, 3), x and y in mm, heading in degrees."""
        return self._bases.poses.copy()

    def place(self, robot: int, pose: tuple[float, float, float]) -> None:
        """Carry a robot to `pose` and put it down there, standing; its odometry does not notice.

        People who are there make way.

        Raises:
            ValueError: a number is not finite, or the robot would overlap a wall or another robot.
        """
        robot = self._index(robot)
        poses = self._bases.poses.copy()
        poses[robot] = checked_poses([pose])[0]
        check_room(poses, self._walls, self.config.radius_mm)
        make_way(self._crowd, poses, of=robot)
        self._bases.poses[robot] = poses[robot]
        self._bases.speeds[robot] = 0.0
        self._sensed = False
        self._snapshot = None

    def rebuild(self, walls: NDArray[np.float64], silent: NDArray[np.bool_]) -> None:
        """Put other walls, (n, 4) in mm, in place of those that there are; `silent` says which are not heard.

        Everything else stays as it is. A wall that is put into a robot lets it out, and not farther in.
        """
        self._build(walls, silent)
        self._sensed = False

    def enter(self, scenery: Scenery, poses: Sequence[tuple[float, float, float]]) -> None:
        """Carry all robots into another building, and put them down there, standing, at `poses`.

        Their odometry does not notice, and their encoders stay as they are.

        Raises:
            ValueError: there are not as many poses as robots, or one has no room; then nothing has changed.
        """
        places = checked_poses(poses)
        if len(places) != len(self):
            raise ValueError(f"found {len(places)} poses; expected one for each robot, {len(self)}")
        solid = scenery.walls[np.hypot(*(scenery.walls[:, 2:] - scenery.walls[:, :2]).T) > 0.0]
        check_room(places, wall_table(solid), self.config.radius_mm)
        self._bases.poses[:] = places
        self._bases.speeds[:] = 0.0
        self._build(scenery.walls, scenery.silent)
        self._furnish(scenery)
        self._sensed = False
        self._snapshot = None

    def _index(self, robot: int) -> int:
        if not 0 <= robot < len(self._bases.poses):
            raise IndexError(f"there is no robot {robot}; expected 0 to {len(self._bases.poses) - 1}")
        return robot

    def _now(self) -> _Snapshot:
        """Return the present state as plain Python numbers, made once a step."""
        if self._snapshot is None:
            arrays = (self._bases.poses, self._bases.odometry, self._bases.speeds, self._bases.contacts)
            self._snapshot = _Snapshot(*(array.tolist() for array in arrays))
        return self._snapshot

    def _sense(self) -> None:
        if not self._sensed:
            sense(
                self._bases.poses,
                self._heard,
                self._reflectors,
                self._crowd,
                self._ears,
                self._talk,
                self._steps,
                self._fan,
                self._noise.table,
                self._sonar_noise_at,
                self._sonar,
                self._infrared,
            )
            self._infrared[:, self._unwired] = False
            self._sensed = True
