"""A robot that MuJoCo moves, behind the interface of `colony.sim.physics`.

The motor controller is like that of a real robot: 100 times a second it moves its target speeds toward the
commanded ones, within the body's limits of acceleration, and sends each motor the speed of its wheel. Nothing
else moves the robot: no pose and no speed is ever set. Odometry counts the angles of the wheel joints, with
the body's errors.

MuJoCo has no randomness, and the robot's errors come from a seed, so that the same calls give the same run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from colony.body import devices
from colony.body.devices import Device
from colony.body.model import Body
from colony.ir.servers import ServerSpec
from colony.ir.types import Value
from colony.nav.maps.stickrep.model import Pose
from colony.sim.chance import Noise
from colony.sim.compiled import Floats, Floats2
from colony.sim.config import RobotConfig, config_of
from colony.sim.devices.actuators import Joint
from colony.sim.devices.beams import DROPOUT_BITS, LidarModel, normal_quantiles, read
from colony.sim.devices.device import SimulatedSensor
from colony.sim.mechanism import Mechanism
from colony.sim.mujoco.model import BEAM_HEIGHT_M, FLOOR, PART, SETTLING_S, TIMESTEP_S, WALLS, build_of, mjcf
from colony.sim.physics import Physics
from colony.sim.sensors.sonar import wall_table
from colony.sim.timeline import StepTimeline
from colony.sim.world.base import bases_at, count_wheels, drivetrain_of
from colony.sim.world.placing import (
    check_clearance,
    checked_docks,
    checked_holes,
    checked_poses,
    checked_walls,
    wall_boxes,
)
from colony.sim.world.world import STILL, PressedBumpers, Situation, Speed

# --- lidar --------------------------------------------------------------------------------------------
#
# Laser scanners whose beams MuJoCo casts, in space: they tilt with the robot.

Cast = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
"""A function that casts rays from a place, (3,) in m, in directions, (n, 3), both in the robot's frame.

It returns the distances in m, (n,), with -1 for a ray that hits nothing.
"""


class RayLidar(SimulatedSensor):
    """A scanner whose noise and dropouts are those of `colony.sim.devices.ranging.Lidar`.

    Args:
        lidar: the scanner.
        world: the physics, for its time.
        cast: casts its beams.
        height_mm: its height above the floor.
        blocked: the beams that the robot's own body blocks; they have no echo.
        seed: the seed of its noise.
    """

    def __init__(
        self,
        lidar: devices.LidarSpec,
        world: Physics,
        cast: Cast,
        *,
        height_mm: float,
        blocked: Iterable[int],
        seed: int,
    ) -> None:
        bearings = lidar.bearings()
        if bearings is None:
            raise ValueError(f"{lidar.count} beams take more than a turn")
        self.fields = (lidar.field,)
        angles = np.radians(bearings.angles)
        self._directions = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(lidar.count)])
        self._place = np.array([lidar.pose.x_mm, lidar.pose.y_mm, height_mm]) / 1e3
        self._blocked = list(blocked)
        self._model = LidarModel(
            u=lidar.pose.x_mm,
            v=lidar.pose.y_mm,
            first=float(angles.min()),
            density=1.0 / math.radians(abs(bearings.step or bearings.spacing)),
            full_range=lidar.range_mm,
            noise=lidar.noise_mm,
            dropouts=round(lidar.dropouts * 2**DROPOUT_BITS),
            person=0.0,
        )
        self._world, self._cast, self._seed = world, cast, seed

    def measure(self, field: str) -> Value:
        """Return the ranges now, in mm; infinity for a beam without an echo."""
        distances = self._cast(self._place, self._directions) * 1e3
        distances[distances < 0.0] = math.inf
        distances[self._blocked] = math.inf
        ranges = np.empty(len(distances))
        read(distances, self._world.elapsed_ns, self._seed, self._model, normal_quantiles(), ranges)
        value: Value = tuple(ranges.tolist())
        return value


# --- lift ---------------------------------------------------------------------------------------------
#
# Lifts: platforms that MuJoCo moves along a line.

LIFT_RESOLUTION_MM = 1.0
"""Resolution of a lift's sensor, and the distance from its goal at which it has arrived."""


class Lift(Joint):
    """A joint along a line that follows its set point, where the motor lifts its load. Stateful, as `Joint`.

    Args:
        joint: the joint.
        world: the physics, for its time.
        position_mm: function that returns where the platform is.
    """

    def __init__(self, joint: devices.JointSpec, world: Physics, position_mm: Callable[[], float]) -> None:
        super().__init__(joint, world)
        self._ends = joint.ends
        self._position_mm = position_mm

    def setpoint_mm(self) -> float:
        """Return where the platform shall be now, on its way at the joint's speed."""
        return self._position()

    def measure(self, field: str) -> Value | None:
        """Return what a field reads: position and motion are those of the platform."""
        if field == "position":
            low, high = self._ends
            steps = round(self._position_mm() / LIFT_RESOLUTION_MM)
            return min(max(steps * LIFT_RESOLUTION_MM, low), high)
        if field == "moving":
            is_late = abs(self._position_mm() - self.setpoint_mm()) > LIFT_RESOLUTION_MM
            return is_late or super().measure(field)
        return super().measure(field)


# --- world --------------------------------------------------------------------------------------------

T = TypeVar("T")

STEP_NS = round(TIMESTEP_S * 1e9)

CONTROL_STEPS = 5
"""Steps of the integration between two rounds of the motor controller, which counts the wheels as well."""

SETTLING_STEPS = 250
"""Steps before the beginning, in which the robot settles on its wheels."""

RESOLUTION_MM = 0.01
"""Displacement that counts as driving: below it, contacts creep."""

_SEEN = np.array([group in (WALLS, FLOOR) for group in range(mujoco.mjNGROUP)], dtype=np.uint8)
_SPEED_DIGITS = 2  # of speeds in mm/s and degrees/s: a robot at rest reads 0


class SpatialPose(NamedTuple):
    """Where the robot is in space: in m, (3,), and the rotation from its frame to the world's, (3, 3)."""

    place: NDArray[np.float64]
    rotation: NDArray[np.float64]


class MujocoWorld:
    """One robot among walls, number 0, moved by MuJoCo. It stands still until its first command.

    Walls are vertical and as high as a room; there are no people and no hazards, and holes in the floor stop
    nobody: sensors that look down see them.
    """

    def __init__(
        self,
        *,
        body: Body,
        walls: ArrayLike,
        pose: tuple[float, float, float],
        config: RobotConfig | None = None,
        seed: int = 0,
        holes: Sequence[ArrayLike] = (),
        docks: Sequence[tuple[float, float, float]] = (),
    ) -> None:
        """Build the model.

        Args:
            body: the robot's body.
            walls: (n, 4), segments x0, y0, x1, y1 in mm, with the free space to the right of each.
            pose: where the robot begins: x and y in mm, heading in degrees.
            config: limits and errors of the robot; by default those of its body.
            seed: seed of the robot's own errors.
            holes: the holes in the floor: polygons, (n, 2) in mm each.
            docks: the poses of robots that stand at a dock.

        Raises:
            ValueError: a shape is wrong, a number is not finite, the robot overlaps a wall, or it has what is
                not simulated here.
        """
        self._config = config or config_of(body)
        self.configs: tuple[RobotConfig, ...] = (self._config,)
        self._build = build_of(body)
        segments, poses = checked_walls(walls), checked_poses([pose])
        self._walls = wall_table(segments)
        self._boxes = wall_boxes(self._walls)
        self._radii = np.array([self._config.radius_mm])
        check_clearance(poses, self._walls, self._radii)
        self._holes, self._docks = checked_holes(holes), checked_docks(docks)
        self.model = mujoco.MjModel.from_xml_string(mjcf(body, segments, tuple(poses[0].tolist())))
        self.data = mujoco.MjData(self.model)
        self._hull = self.model.geom(PART.hull).id
        self._wheels = slice(
            self.model.joint(PART.left).qposadr[0], self.model.joint(PART.right).qposadr[0] + 1
        )
        self._wheel_dofs = slice(
            self.model.joint(PART.left).dofadr[0], self.model.joint(PART.right).dofadr[0] + 1
        )
        self._setpoints: dict[int, Callable[[], float]] = {}
        self._steps = 0
        self._timeline = StepTimeline(self.configs)
        mujoco.mj_step(self.model, self.data, nstep=SETTLING_STEPS)
        self.seed = seed
        self._noise = Noise(1, seed)
        errors = 1.0 + self._config.wheel_scale * self._noise.peek(2)
        self._bases = bases_at(np.array([self.true_pose(0)]), errors, (self._config,))
        self._drivetrain = drivetrain_of(self._config)
        self._angles: list[float] = self.data.qpos[self._wheels].tolist()
        self._targets = STILL
        self._commands = STILL
        self._distance_mm = 0.0
        self._counted: tuple[float, float] = tuple(self.data.qpos[:2].tolist())
        self._bearings: tuple[float, ...] = ()
        self._bumps = 0
        self._situation: Situation | None = None

    def __len__(self) -> int:
        """Return the number of robots: 1."""
        return 1

    # --- commands and time ---------------------------------------------------------------------------

    def command(
        self, robot: int, velocity_mm_s: float, turn_deg_s: float, sideways_mm_s: float = 0.0
    ) -> None:
        """Set the target speeds of the robot; see `Physics`."""
        commands = Speed(*self._config.bounded(velocity_mm_s, turn_deg_s, sideways_mm_s))
        _check_robot(robot)
        self.carry_out(robot, partial(self._set_commands, commands))

    def _set_commands(self, commands: Speed) -> None:
        self._commands = commands

    def carry_out(self, robot: int, command: Callable[[], None]) -> None:
        """Call `command` after the delay of the robot's commands; see `Physics`."""
        self._timeline.carry_out(robot, command)

    def advance(self, dt_s: float) -> None:
        """Advance time by `dt_s` seconds, in whole steps of the integration; see `Physics`.

        Time that is no whole number of steps is made up for by the next call.
        """
        self._timeline.advance(dt_s, self._step)

    def _step(self, dt_s: float) -> None:
        last = (self._timeline.elapsed_ns + round(dt_s * 1e9)) // STEP_NS
        while self._steps < last:
            begun = self._steps % CONTROL_STEPS
            if begun == 0:
                self._control()
            steps = min(CONTROL_STEPS - begun, last - self._steps)
            mujoco.mj_step(self.model, self.data, nstep=steps)
            self._steps += steps
            self._timeline.elapsed_ns = self._steps * STEP_NS
            self._count()
        self._situation = None

    def _control(self) -> None:
        """Move the targets of the motors toward what is commanded."""
        period_s = CONTROL_STEPS * TIMESTEP_S
        limits = (
            self._config.acceleration_mm_s2 * period_s,
            self._config.turn_acceleration_deg_s2 * period_s,
        )
        velocity, turn = (
            target + _within(command - target, limit)
            for target, command, limit in zip(self._targets[:2], self._commands[:2], limits, strict=True)
        )
        # A ramp is fed forward: motors get the speed that the target will have when they have caught up.
        ahead = velocity + (velocity - self._targets.velocity_mm_s) * SETTLING_S / period_s
        turning = turn + (turn - self._targets.turn_deg_s) * self._build.turn_settling_s / period_s
        self._targets = Speed(velocity, turn)
        half = math.radians(turning) * self._build.wheel_base / 2.0
        radius = self._build.wheel_radius
        self.data.actuator(PART.left).ctrl = (ahead / 1e3 - half) / radius
        self.data.actuator(PART.right).ctrl = (ahead / 1e3 + half) / radius
        for actuator, setpoint in self._setpoints.items():
            self.data.ctrl[actuator] = setpoint() / 1e3

    def _count(self) -> None:
        """Count what the wheels rolled and how far the robot came, and see what its hull touches."""
        angles: list[float] = self.data.qpos[self._wheels].tolist()
        left, right = (
            (now - before) * self._build.wheel_radius * 1e3
            for now, before in zip(angles, self._angles, strict=True)
        )
        self._angles = angles
        column = self._noise.take(2)
        count_wheels(0, self._bases, self._drivetrain, left, right, self._noise.table, column)
        self._count_distance()
        self._touch()

    def _count_distance(self) -> None:
        x, y = self.data.qpos[:2].tolist()
        moved_mm = math.hypot(x - self._counted[0], y - self._counted[1]) * 1e3
        if moved_mm >= RESOLUTION_MM:
            self._distance_mm += moved_mm
            self._counted = (x, y)

    def _touch(self) -> None:
        """Note where the hull touches anything."""
        before, contacts = self._bearings, self.data.contact
        self._bearings = ()
        touching = (contacts.geom == self._hull).any(axis=1)
        if touching.any():
            x, y, heading = self.true_pose(0)
            self._bearings = tuple(
                (math.degrees(math.atan2(x - at_x * 1e3, at_y * 1e3 - y)) - heading) % 360.0
                for at_x, at_y, _ in contacts.pos[touching].tolist()
            )
            self._bumps += not before

    def on_step(self, callback: Callable[[], None]) -> None:
        """Call `callback` at the end of each step from now on; see `Physics`."""
        self._timeline.on_step(callback)

    @property
    def elapsed_ns(self) -> int:
        """The nanoseconds that were simulated so far."""
        return self._timeline.elapsed_ns

    # --- readings ------------------------------------------------------------------------------------

    def placement(self) -> SpatialPose:
        """Return where the robot is in space; it tilts a little as it brakes."""
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, self.data.qpos[3:7])
        return SpatialPose(self.data.qpos[:3].copy(), rotation.reshape(3, 3))

    def true_pose(self, robot: int) -> Pose:
        """Return the true pose of the robot; see `Physics`."""
        _check_robot(robot)
        x, y, _, qw, qx, qy, qz = self.data.qpos[:7].tolist()
        bearing = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
        heading_deg = (math.degrees(bearing) - 90.0) % 360.0
        return Pose(x * 1e3, y * 1e3, heading_deg % 360.0)  # -1e-20 % 360 is 360

    def distance(self, robot: int) -> float:
        """Return the distance that the robot has driven so far, in mm; see `Physics`."""
        _check_robot(robot)
        return self._distance_mm

    def bumps(self, robot: int) -> int:
        """Return the number of the robot's collisions so far; see `Physics`."""
        _check_robot(robot)
        return self._bumps

    def bumper(self, robot: int) -> PressedBumpers:
        """Return the bumpers of the robot, pressed by walls; see `Physics`."""
        _check_robot(robot)
        ahead = [math.cos(math.radians(bearing)) for bearing in self._bearings]
        return PressedBumpers(
            front=any(part >= 0.0 for part in ahead), rear=any(part < 0.0 for part in ahead)
        )

    def contact_bearings(self, robot: int) -> tuple[float, ...]:
        """Return the bearings at which walls touch the robot; see `Physics`."""
        _check_robot(robot)
        return self._bearings

    def placements(self, robot: int) -> int:
        """Return 0: nothing places the robot; see `Physics`."""
        _check_robot(robot)
        return 0

    def compass(self, robot: int) -> float:
        """Return the true heading of the robot, in degrees: nothing disturbs the compass; see `Physics`."""
        return self.true_pose(robot).heading_deg

    def odometry(self, robot: int) -> Pose:
        """Return the pose of the robot according to the angles of its wheels; see `Physics`."""
        return Pose(*self._bases.odometry[_check_robot(robot)].tolist())

    def travel(self, robot: int) -> tuple[float, ...]:
        """Return how far each wheel has rolled by its own report, in mm; see `Physics`."""
        _check_robot(robot)
        left, right = self._bases.travel[0].tolist()
        return left, right

    def speed(self, robot: int) -> Speed:
        """Return the speed of the robot according to its wheels; see `Physics`."""
        left, right = self._rolling_mm_s(robot)
        turn = math.degrees((right - left) / self._config.wheel_base_mm)
        return Speed(_reported((left + right) / 2.0), _reported(turn))

    def wheel_speed(self, robot: int) -> float:
        """Return the mean magnitude of the speeds of both wheels, in mm/s."""
        left, right = self._rolling_mm_s(robot)
        return _reported((abs(left) + abs(right)) / 2.0)

    def _rolling_mm_s(self, robot: int) -> tuple[float, float]:
        _check_robot(robot)
        left, right = self.data.qvel[self._wheel_dofs].tolist()
        return left * self._build.wheel_radius * 1e3, right * self._build.wheel_radius * 1e3

    def sonar(self, robot: int) -> NDArray[np.float64]:
        """Raise ValueError: no sonars are simulated."""
        raise ValueError("the robots have no ring of sonars")

    def infrared(self, robot: int) -> NDArray[np.bool_]:
        """Raise ValueError: no infrared detectors are simulated."""
        raise ValueError("the robots have no ring of sonars")

    @property
    def holes(self) -> tuple[NDArray[np.float64], ...]:
        """The holes in the floor; see `Physics`."""
        return self._holes

    @property
    def docks(self) -> tuple[Pose, ...]:
        """The docks: the poses of robots that stand at them."""
        return self._docks

    @property
    def person_radius_mm(self) -> float:
        """The radius of a person: 0, there is nobody."""
        return 0.0

    def situation(self) -> Situation:
        """Return the robot's pose and the walls; see `Physics`."""
        if self._situation is None:
            poses, nobody = np.array([self.true_pose(0)]), np.empty((0, 2))
            self._situation = Situation(poses, self._radii, nobody, self._walls, self._boxes)
        return self._situation

    def shared(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return what `make` makes: there is one robot; see `Physics`."""
        return make()

    # --- devices -------------------------------------------------------------------------------------

    def own_mechanism(self, spec: ServerSpec, device: Device, robot: int, seed: int) -> Mechanism | None:
        """Return the mechanism of a lidar or a lift; see `Physics`."""
        _check_robot(robot)
        match device:
            case devices.LidarSpec():
                blocked = next((field.blocked for field in spec.fields if field.name == device.field), ())
                height_mm = 1e3 * (self._build.height + BEAM_HEIGHT_M)
                return RayLidar(device, self, self.cast, height_mm=height_mm, blocked=blocked, seed=seed)
            case devices.JointSpec():
                joint, actuator = self.data.joint(spec.name), self.model.actuator(spec.name).id
                lift = Lift(device, self, lambda: float(joint.qpos[0]) * 1e3)
                self._setpoints[actuator] = lift.setpoint_mm
                return lift
            case _:
                return None

    def cast(self, place: Floats, directions: Floats2) -> Floats:
        """Cast rays at walls and floor from a place on the robot.

        Args:
            place: (3,), in m, in the robot's frame.
            directions: (n, 3), unit vectors in that frame.

        Returns:
            The distances in m, (n,), -1 for a ray that hits nothing.
        """
        origin, rotation = self.placement()
        count = len(directions)
        geoms, distances = np.empty(count, dtype=np.int32), np.empty(count)
        mujoco.mj_multiRay(
            m=self.model,
            d=self.data,
            pnt=origin + rotation @ place,
            vec=(directions @ rotation.T).ravel(),
            geomgroup=_SEEN,
            flg_static=True,
            bodyexclude=-1,
            geomid=geoms,
            dist=distances,
            normal=None,
            nray=count,
            cutoff=mujoco.mjMAXVAL,
        )
        return distances


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _reported(speed: float) -> float:
    """Return a speed with the digits that are reported, and without a sign if it is 0."""
    return round(speed, _SPEED_DIGITS) + 0.0


def _check_robot(robot: int) -> int:
    if robot != 0:
        raise IndexError(f"no robot {robot}; expected 0")
    return robot
