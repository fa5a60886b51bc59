"""A building with robots: commands and time are the input, sensor readings and poses the output.

The world has neither I/O nor a clock: `World.advance` advances time. All randomness comes from two seeds. The
world's seed is for the robots' own errors. Each robot has its own generator, so that the same calls give the
same run bit for bit, independent of other robots of the same kinds and of the sensors that are read. The
scenery's seed is for the hazards of the building (docs/hazards.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colony.body.devices import Device
from colony.ir.servers import ServerSpec
from colony.nav.maps.stickrep.model import Pose
from colony.sim.chance import SEED_MODULUS, Noise
from colony.sim.config import RingConfig, RobotConfig, rome_config
from colony.sim.hazards.scenery import Scenery, bare_scenery
from colony.sim.sensors.sonar import CrossTalk, Rings, corner_reflectors, disturbance_deg, wall_table
from colony.sim.timeline import StepTimeline
from colony.sim.world.base import SLICE_S, bases_at, drivetrain_of
from colony.sim.world.people import X, Y, crowd_of, make_way
from colony.sim.world.placing import (
    check_clearance,
    checked_docks,
    checked_holes,
    checked_poses,
    checked_walls,
    wall_boxes,
)
from colony.sim.world.stepping import contact_bearings, floor_of, step

T = TypeVar("T")

SUBSTEP_S = 0.05
"""Largest time in seconds between two moves of people, or two checks for slips."""


class Speed(NamedTuple):
    """The speed of a base: ahead and to the left in mm/s, turning counterclockwise in degrees/s."""

    velocity_mm_s: float
    turn_deg_s: float
    sideways_mm_s: float = 0.0

    @property
    def ground_mm_s(self) -> float:
        """The speed of the robot's center."""
        return math.hypot(self.velocity_mm_s, self.sideways_mm_s)


STILL = Speed(0.0, 0.0)


class PressedBumpers(NamedTuple):
    """The bumpers of the two halves of the hull; True if pressed."""

    front: bool
    rear: bool


class Situation(NamedTuple):
    """What stands where at one time, for sensors; the arrays must not be modified.

    Attributes:
        poses: (robots, 3), the true poses, x and y in mm, heading in degrees.
        people: (people, 2), x and y in mm of their centers.
        radii: (robots,), the radii of their hulls in mm.
        walls: (n, 7), the walls that light and sound detect, from `wall_table`.
        boxes: their boxes, from `wall_boxes`.
    """

    poses: NDArray[np.float64]
    radii: NDArray[np.float64]
    people: NDArray[np.float64]
    walls: NDArray[np.float64]
    boxes: NDArray[np.float64]


class _Snapshot(NamedTuple):
    """The state of all robots, one row each."""

    poses: list[list[float]]
    odometry: list[list[float]]
    speeds: list[list[float]]
    contacts: list[list[bool]]


class World:
    """Robots of one kind or several among walls, or in the scenery of a building.

    Robots are numbered from 0 in the order of `poses`; they detect and block each other, each with its own
    hull. A robot stands still until its first command, and keeps its last one.

    The attribute `configs` has the parameters of each robot.
    """

    def __init__(
        self,
        *,
        walls: ArrayLike | Scenery,
        poses: Sequence[tuple[float, float, float]],
        config: RobotConfig | Sequence[RobotConfig] | None = None,
        seed: int = 0,
        holes: Sequence[ArrayLike] = (),
        docks: Sequence[tuple[float, float, float]] = (),
    ) -> None:
        """Build a world.

        Args:
            walls: (n, 4), segments x0, y0, x1, y1 in mm; x is east and y north. Or a scenery, with its
                people, joints and other hazards.
            poses: one (x, y, heading) per robot, in mm and degrees counterclockwise from north. People at
                these positions are moved.
            config: the parameters of the robots, of all or of each; RoME by default.
            seed: seed of the robots' own errors.
            holes: the holes in the floor, in addition to those of the scenery: polygons, (n, 2) in mm each.
                Robots drive over them; sensors that look down see them.
            docks: the docks in addition to those of the scenery: the poses of robots that stand at them.

        Raises:
            ValueError: a shape is wrong, a number is not finite, a robot overlaps a wall or another robot, or
                there is not one config per robot.
        """
        scenery = walls if isinstance(walls, Scenery) else bare_scenery(checked_walls(walls))
        scenery = replace(
            scenery,
            holes=(*scenery.holes, *checked_holes(holes)),
            docks=(*scenery.docks, *checked_docks(docks)),
        )
        initial_poses = checked_poses(poses)
        self.seed = seed
        """Seed of the robots' own errors."""
        self.configs = configs = _config_of_each(config or rome_config(), len(initial_poses))
        self._channels = max(each.channels for each in configs)
        self._wheels = max(len(each.wheels) for each in configs)
        self._noise = Noise(len(initial_poses), seed)
        errors = np.array([[each.wheel_scale] for each in configs]) * self._noise.peek(self._wheels)
        radii = np.array([each.radius_mm for each in configs], dtype=np.float64)
        self._bases = bases_at(initial_poses, scenery.encoder_scale * (1.0 + errors), configs)
        self._crossings = np.zeros(len(initial_poses), dtype=np.int64)
        self._build(scenery.walls, scenery.silent, outlines=scenery.outlines)
        check_clearance(initial_poses, self._walls, radii)
        self._set_scenery(scenery)
        self._steps = 0
        self._drivetrains = np.array([drivetrain_of(each) for each in configs], dtype=np.float64)
        self._rings = _equal_rings(configs)
        self._sonar_noise_column = self._noise.take(self._channels)
        self._placements = [0] * len(initial_poses)
        self._timeline = StepTimeline(configs)
        self._shared: dict[Hashable, object] = {}
        self._snapshot: _Snapshot | None = None
        self._situation: Situation | None = None

    def _build(
        self, walls: NDArray[np.float64], silent: NDArray[np.bool_], *, outlines: bool = False
    ) -> None:
        has_length = np.hypot(*(walls[:, 2:] - walls[:, :2]).T) > 0.0
        self._walls = wall_table(walls[has_length])
        self._audible_walls = wall_table(walls[has_length & ~silent])
        self._boxes = wall_boxes(self._walls, outlines=outlines)
        self._audible_boxes = wall_boxes(self._audible_walls, outlines=outlines)
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
        self._cross_talk = CrossTalk(scenery.cross_talk, events, self._channels)
        self._compass_disturbance = scenery.compass_disturbance
        self._holes = scenery.holes
        self._docks = scenery.docks

    def __len__(self) -> int:
        """Return the number of robots."""
        return len(self._bases.poses)

    def command(
        self, robot: int, velocity_mm_s: float, turn_deg_s: float, sideways_mm_s: float = 0.0
    ) -> None:
        """Set the target speeds of a robot, clamped to its limits, after the delay of its commands.

        Raises:
            ValueError: a speed is not finite.
        """
        robot = self._index(robot)
        config = self.configs[robot]
        targets = config.bounded(velocity_mm_s, turn_deg_s, sideways_mm_s)
        if config.command_delay_ns:
            self.carry_out(robot, partial(self._set_targets, robot, targets))
        else:
            self._set_targets(robot, targets)

    def _set_targets(self, robot: int, targets: tuple[float, float, float]) -> None:
        self._bases.commands[robot] = targets

    def carry_out(self, robot: int, command: Callable[[], None]) -> None:
        """Call `command` after the delay of a robot's commands, at once without one."""
        self._timeline.carry_out(robot, command)

    def advance(self, dt_s: float) -> None:
        """Advance time by `dt_s` seconds, in one step, or in several if commands or readings are delayed.

        Raises:
            ValueError: the time is not above 0, or beyond `MAX_STEP_S`.
        """
        self._timeline.advance(dt_s, self._step)

    def _step(self, dt_s: float) -> None:
        substeps = math.ceil(dt_s / SUBSTEP_S - 1e-9) if self._has_events else 1
        slices = math.ceil(dt_s / substeps / SLICE_S - 1e-9)
        noise_columns = self._wheels * slices
        noise_column = self._noise.take(self._channels + noise_columns * substeps)
        self._sonar_noise_column = noise_column
        step(
            self._bases,
            self._drivetrains,
            self._walls,
            self._boxes,
            self._crowd,
            self._floor,
            self._noise.table,
            noise_column + self._channels,
            noise_columns,
            substeps,
            slices,
            self._has_events,
            dt_s,
        )
        self._steps += 1
        self._forget()

    def sonar(self, robot: int) -> NDArray[np.float64]:
        """Return the sonar readings, (channels,) float64 in mm, counterclockwise.

        Raises:
            ValueError: the robot has no ring of sonars.
        """
        rings, row = self._measured_rings(robot)
        readings: NDArray[np.float64] = rings.sonar[row].copy()
        return readings

    def infrared(self, robot: int) -> NDArray[np.bool_]:
        """Return the infrared readings, (channels,) bool, numbered like the sonars.

        Raises:
            ValueError: the robot has no ring of sonars.
        """
        rings, row = self._measured_rings(robot)
        readings: NDArray[np.bool_] = rings.infrared[row].copy()
        return readings

    def bumper(self, robot: int) -> PressedBumpers:
        """Return the bumpers of a robot, pressed by walls, people or other robots."""
        return PressedBumpers(*self._current_state().contacts[self._index(robot)])

    def contact_bearings(self, robot: int) -> tuple[float, ...]:
        """Return the bearings at which a robot is touched, in degrees counterclockwise from ahead.

        They are in [0, 360), one for each wall, robot and person; there are none unless a bumper is pressed.
        """
        if not any(self.bumper(robot)):
            return ()
        found = contact_bearings(
            self._bases.poses,
            self.people,
            self._walls,
            robot,
            radii_mm=self._bases.radii,
            person_radius_mm=self.person_radius_mm,
        )
        return tuple(found.tolist())

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

    def on_step(self, callback: Callable[[], None]) -> None:
        """Call `callback` at the end of each step from now on."""
        self._timeline.on_step(callback)

    def shared(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return what sensors of several robots share under this key; `make` makes it at the first call."""
        if key not in self._shared:
            self._shared[key] = make()
        return cast("T", self._shared[key])

    @property
    def elapsed_ns(self) -> int:
        """The nanoseconds that were simulated so far."""
        return self._timeline.elapsed_ns

    @property
    def holes(self) -> tuple[NDArray[np.float64], ...]:
        """The holes in the floor: polygons, (n, 2) in mm each."""
        return self._holes

    @property
    def docks(self) -> tuple[Pose, ...]:
        """The docks: the poses of robots that stand at them."""
        return self._docks

    @property
    def person_radius_mm(self) -> float:
        """The radius of a person."""
        return self._crowd.radius

    def situation(self) -> Situation:
        """Return what stands where now; it stays the same when the world goes on."""
        if self._situation is None:
            bases = self._bases
            self._situation = Situation(
                bases.poses.copy(), bases.radii, self.people, self._audible_walls, self._audible_boxes
            )
        return self._situation

    def own_mechanism(self, spec: ServerSpec, device: Device, robot: int, seed: int) -> None:
        """Return None: devices need poses and time alone; see `colony.sim.physics.Physics`."""

    @property
    def walls(self) -> NDArray[np.float64]:
        """The current solid segments, (n, 7), from `wall_table`.

        Each change creates a new array, which must not be modified.
        """
        return self._walls

    @property
    def people(self) -> NDArray[np.float64]:
        """The positions of the people: a copy, (people, 2), x and y in mm of their centers."""
        return self._crowd.people[:, X : Y + 1].copy()

    def distance(self, robot: int) -> float:
        """Return the distance that a robot has driven so far, in any direction, in mm."""
        return float(self._bases.distances[self._index(robot)])

    def travel(self, robot: int) -> tuple[float, ...]:
        """Return how far each wheel of a robot has rolled by its own report, in mm.

        The wheels are left and right, or those of the body in its order.
        """
        robot = self._index(robot)
        return tuple(self._bases.travel[robot, : len(self.configs[robot].wheels)].tolist())

    def speed(self, robot: int) -> Speed:
        """Return the current speed of a robot."""
        return Speed(*self._current_state().speeds[self._index(robot)])

    def wheel_speed(self, robot: int) -> float:
        """Return the mean magnitude of the speeds of the wheels, in mm/s."""
        speed, config = self.speed(robot), self.configs[robot]
        ahead, left, turn = speed.velocity_mm_s, speed.sideways_mm_s, math.radians(speed.turn_deg_s)
        rolled = [ahead * w.ahead + left * w.left + turn * w.turn_mm for w in config.wheels]
        return sum(map(abs, rolled)) / len(rolled)

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
        check_clearance(poses, self._walls, self._bases.radii)
        make_way(self._crowd, poses, robot=robot)
        self._bases.poses[robot] = poses[robot]
        self._bases.speeds[robot] = 0.0
        self._placements[robot] += 1
        self._forget()

    def placements(self, robot: int) -> int:
        """Return how often a robot was moved by `place` or `enter` instead of by its wheels."""
        return self._placements[self._index(robot)]

    def rebuild(self, walls: NDArray[np.float64], silent: NDArray[np.bool_]) -> None:
        """Replace all walls by others, (n, 4) in mm; `silent` is a mask of walls that sensors do not detect.

        Everything else stays the same. A robot inside a new wall can move out of it, but not farther in.
        """
        self._build(walls, silent)
        self._forget()

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
        check_clearance(new_poses, wall_table(solid), self._bases.radii)
        self._bases.poses[:] = new_poses
        self._bases.speeds[:] = 0.0
        self._placements = [count + 1 for count in self._placements]
        self._build(scenery.walls, scenery.silent, outlines=scenery.outlines)
        self._set_scenery(scenery)
        self._forget()

    def _index(self, robot: int) -> int:
        if not 0 <= robot < len(self._bases.poses):
            raise IndexError(f"no robot {robot}; expected 0 to {len(self._bases.poses) - 1}")
        return robot

    def _current_state(self) -> _Snapshot:
        """Return the current state as plain Python numbers, converted once per step."""
        if self._snapshot is None:
            bases = self._bases
            self._snapshot = _Snapshot(
                bases.poses.tolist(), bases.odometry.tolist(), bases.speeds.tolist(), bases.contacts.tolist()
            )
        return self._snapshot

    def _forget(self) -> None:
        """Forget what was measured and converted before a change of the state."""
        self._snapshot = self._situation = None
        for rings, _ in self._rings.values():
            rings.is_measured = False

    def _measured_rings(self, robot: int) -> tuple[Rings, int]:
        """Return the measured rings that are equal to a robot's, and its row in them."""
        rings, row = self._rings.get(self._index(robot), (None, 0))
        if rings is None:
            raise ValueError(f"robot {robot} has no ring of sonars")
        if not rings.is_measured:
            rings.measure(
                self._bases.poses,
                self._bases.radii,
                self._audible_walls,
                self._audible_boxes,
                self._reflectors,
                self._crowd,
                self._cross_talk,
                self._steps,
                self._noise.table,
                self._sonar_noise_column,
            )
        return rings, row


def _config_of_each(config: RobotConfig | Sequence[RobotConfig], count: int) -> tuple[RobotConfig, ...]:
    if isinstance(config, RobotConfig):
        return (config,) * count
    if len(config) != count:
        raise ValueError(f"found {len(config)} configs; expected one for each robot, {count}")
    return tuple(config)


def _equal_rings(configs: Sequence[RobotConfig]) -> dict[int, tuple[Rings, int]]:
    """Return, for each robot with a ring, all rings that are equal to its own, and its row in them."""
    robots_by_ring: dict[RingConfig, list[int]] = {}
    for robot, config in enumerate(configs):
        if config.ring is not None:
            robots_by_ring.setdefault(config.ring, []).append(robot)
    found: dict[int, tuple[Rings, int]] = {}
    for ring, robots in robots_by_ring.items():
        rings = Rings(ring, robots)
        found.update((robot, (rings, row)) for row, robot in enumerate(robots))
    return found
