"""The motion of the robots' bases: wheels, limited acceleration, a round hull stopped by obstacles.

A step is divided into slices of at most twenty milliseconds. In each slice the speeds approach the commands
within the acceleration limits, each for itself, and the robot drives an exact arc: its velocity, ahead and to
the left, is constant in its own frame, which turns. A base with two wheels has no speed to the left. If the
arc would end inside a wall or another robot, the base goes as far as possible and its wheels stall; it can
still turn and drive away. Robots never jump over obstacles: where the distance in a slice is longer than the
hull's radius, the place nearest to each obstacle counts as well as the end. Within a step the robots move one
after the other.

Odometry integrates the wheels' reports with the same arcs. Each wheel has its own scale error, and random
errors whose variance grows with the distance. With two wheels, w apart, a motion of `a` ahead that turns by
`t` (radians) rolls the left one by a - t w/2 and the right one by a + t w/2. Wheels of a base that drives
sideways roll by a p + s q + t r in a motion of `a` ahead and `s` to the left; `colony.body.model.Rolling` has
p, q and r of each. Odometry takes the motion that fits their reports best, in the sense of least squares.
What contradicts all rigid motions is lost, as on the real base.

Positions are in mm, headings in degrees counterclockwise from north, speeds in mm/s and degrees/s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from colony.sim.compiled import Bools2, Floats, Floats2, Floats4, Ints, called, compiled, inlined
from colony.sim.config import RobotConfig
from colony.sim.world.people import Crowd
from colony.sim.world.placing import GROUP, box_gap

SLICE_S = 0.02
"""Largest time in seconds over which speeds are considered constant."""

SKIN_MM = 1.0
"""Distance from the hull that counts as contact."""

_BISECTIONS = 40


class Bases(NamedTuple):
    """The state of all robots, one row each, with work space.

    Attributes:
        poses, odometry: (robots, 3), x, y, heading.
        speeds, commands: (robots, 3), ahead, turning, and to the left.
        scales: (robots, wheels), scale factors of the wheels: left and right; or those of the body's order.
        wheels: (robots, wheels, 2, 3), what each wheel rolls of a motion ahead, to the left, and turning in
            radians; and its part in the motion that fits all reports best.
        travel: (robots, wheels), how far the wheels have rolled by their own reports.
        distances: (robots,), lengths of the paths of the centers so far.
        contacts: (robots, 2), front and rear bumper.
        bumps: (robots,), number of collisions so far.
        impacts: (robots,), largest speed in a collision so far.
        radii: (robots,), radii of the hulls.
        wall_buffer, robot_buffer, person_buffer: (walls,), (robots,), (people,), indices of nearby objects.
    """

    poses: Floats2
    odometry: Floats2
    speeds: Floats2
    commands: Floats2
    scales: Floats2
    wheels: Floats4
    travel: Floats2
    distances: Floats
    contacts: Bools2
    bumps: Ints
    impacts: Floats
    radii: Floats
    wall_buffer: Ints
    robot_buffer: Ints
    person_buffer: Ints


def bases_at(poses: Floats2, scales: Floats2, configs: Sequence[RobotConfig]) -> Bases:
    """Return bases that stand at `poses`, (robots, 3), with the same odometry, and empty work space."""
    count = len(poses)
    wheels = np.zeros((*scales.shape, 2, 3))
    for robot, config in enumerate(configs):
        rolling = np.array(config.wheels)
        # Two wheels cannot report a motion to the left.
        motions = rolling if config.is_omnidirectional else rolling[:, ::2]
        fit = np.linalg.solve(motions.T @ motions, motions.T).T
        wheels[robot, : len(rolling), 0] = rolling
        wheels[robot, : len(rolling), 1, :: 1 if config.is_omnidirectional else 2] = fit
    return Bases(
        poses=poses,
        odometry=poses.copy(),
        speeds=np.zeros((count, 3)),
        commands=np.zeros((count, 3)),
        scales=scales,
        wheels=wheels,
        travel=np.zeros_like(scales),
        distances=np.zeros(count),
        contacts=np.zeros((count, 2), dtype=np.bool_),
        bumps=np.zeros(count, dtype=np.int64),
        impacts=np.zeros(count),
        radii=np.array([config.radius_mm for config in configs], dtype=np.float64),
        wall_buffer=np.empty(0, dtype=np.int64),
        robot_buffer=np.empty(count, dtype=np.int64),
        person_buffer=np.empty(0, dtype=np.int64),
    )


class NearCounts(NamedTuple):
    """The counts of nearby walls, robots and people in the work space of `Bases`."""

    walls: int
    robots: int
    people: int


class Drivetrain(NamedTuple):
    """The parameters of a drivetrain, as in `RobotConfig`; `slip` is in mm per square root of a mm.

    `omni_wheels` is their number; it and `sideways_acceleration` are 0 for two wheels.
    """

    radius: float
    wheel_base: float
    omni_wheels: float
    acceleration: float
    turn_acceleration: float
    sideways_acceleration: float
    slip: float


def drivetrain_of(config: RobotConfig) -> Drivetrain:
    """Return the drivetrain of a robot."""
    return Drivetrain(
        radius=config.radius_mm,
        wheel_base=config.wheel_base_mm,
        omni_wheels=float(len(config.omni_wheels)),
        acceleration=config.acceleration_mm_s2,
        turn_acceleration=config.turn_acceleration_deg_s2,
        sideways_acceleration=config.sideways_acceleration_mm_s2,
        slip=config.wheel_slip_mm / math.sqrt(1000.0),
    )


@inlined
def _wall_vector(walls: Floats2, wall: int, x: float, y: float) -> tuple[float, float]:
    """Return the vector from a point to the nearest point of a wall."""
    ax, ay, ex, ey = walls[wall, 0] - x, walls[wall, 1] - y, walls[wall, 4], walls[wall, 5]
    along = min(max(-(ax * ex + ay * ey), 0.0), walls[wall, 6])
    return ax + along * ex, ay + along * ey


@inlined
def _wall_distance(walls: Floats2, wall: int, x: float, y: float) -> float:
    """Return the distance from a point to a wall."""
    dx, dy = _wall_vector(walls, wall, x, y)
    return math.sqrt(dx * dx + dy * dy)


@inlined
def _approach(speed: float, target: float, limit: float) -> float:
    """Return `speed`, changed toward `target` by at most `limit`."""
    return speed + min(max(target - speed, -limit), limit)


@inlined
def _arc(heading: float, ahead: float, left: float, turn: float) -> tuple[float, float]:
    """Return the displacement along an arc that turns by `turn` degrees, of lengths in the robot's frame."""
    half = math.radians(turn) / 2.0
    shrinking = math.sin(half) / half if abs(half) > 1e-9 else 1.0
    along, chord, chord_left = math.radians(heading) + half, ahead * shrinking, left * shrinking
    return (
        -math.sin(along) * chord - math.cos(along) * chord_left,
        math.cos(along) * chord - math.sin(along) * chord_left,
    )


@inlined
def _ground_speed(speeds: Floats2, robot: int) -> float:
    """Return the speed of a robot's center."""
    return math.hypot(speeds[robot, 0], speeds[robot, 2])


@inlined
def _nearest_to_wall(x: float, y: float, dx: float, dy: float, walls: Floats2, wall: int) -> float:
    """Return the fraction of (dx, dy) after which a point at (x, y) is nearest to a wall.

    The distance of a point that moves straight to a segment is convex, so a ternary search finds it.
    """
    low, high = 0.0, 1.0
    for _ in range(2 * _BISECTIONS):
        third = (high - low) / 3.0
        first, second = low + third, high - third
        near = _wall_distance(walls, wall, x + first * dx, y + first * dy)
        if near <= _wall_distance(walls, wall, x + second * dx, y + second * dy):
            high = second
        else:
            low = first
    return (low + high) / 2.0


@inlined
def _free_of_wall(
    x: float, y: float, dx: float, dy: float, walls: Floats2, wall: int, radius: float
) -> float:
    """Return the fraction of (dx, dy) that a hull at (x, y) can move before it touches a wall.

    If the hull is already in the wall, only motion toward the wall is stopped.
    """
    before = _wall_distance(walls, wall, x, y)
    after = _wall_distance(walls, wall, x + dx, y + dy)
    free = high = 1.0
    if after >= radius and dx * dx + dy * dy > radius * radius:
        high = _nearest_to_wall(x, y, dx, dy, walls, wall)
        after = _wall_distance(walls, wall, x + high * dx, y + high * dy)
    if after < radius and after < before:
        free = 0.0
        for _ in range(_BISECTIONS if before > radius else 0):
            middle = (free + high) / 2.0
            if _wall_distance(walls, wall, x + middle * dx, y + middle * dy) < radius:
                high = middle
            else:
                free = middle
    return free


@inlined
def _free_of_hull(ox: float, oy: float, dx: float, dy: float, min_distance: float) -> float:
    """Return the fraction of (dx, dy) that a hull can move before it touches another at (ox, oy)."""
    before, after = math.hypot(ox, oy), math.hypot(ox - dx, oy - dy)
    free = high = 1.0
    squared = dx * dx + dy * dy
    if after >= min_distance and squared > min_distance * min_distance:
        high = min(max((ox * dx + oy * dy) / squared, 0.0), 1.0)
        after = math.hypot(ox - high * dx, oy - high * dy)
    if after < min_distance and after < before:
        free = 0.0
        for _ in range(_BISECTIONS if before > min_distance else 0):
            middle = (free + high) / 2.0
            if math.hypot(ox - middle * dx, oy - middle * dy) < min_distance:
                high = middle
            else:
                free = middle
    return free


@inlined
def _gather(
    robot: int, bases: Bases, walls: Floats2, boxes: Floats2, crowd: Crowd, distance: float, radius: float
) -> NearCounts:
    """Collect everything that a robot may touch within `distance` in the work space; return the counts."""
    x, y = bases.poses[robot, 0], bases.poses[robot, 1]
    limit = (radius + distance + SKIN_MM) ** 2
    wall_count = 0
    for group in range(boxes.shape[0]):
        if box_gap(boxes, group, x, y) < limit:
            for wall in range(group * GROUP, min((group + 1) * GROUP, walls.shape[0])):
                dx, dy = _wall_vector(walls, wall, x, y)
                if dx * dx + dy * dy < limit:
                    bases.wall_buffer[wall_count] = wall
                    wall_count += 1
    robot_count = 0
    for other in range(bases.poses.shape[0]):
        limit = (radius + bases.radii[other] + distance + SKIN_MM) ** 2
        dx, dy = bases.poses[other, 0] - x, bases.poses[other, 1] - y
        if dx * dx + dy * dy < limit and other != robot:
            bases.robot_buffer[robot_count] = other
            robot_count += 1
    limit = (radius + crowd.radius + distance + SKIN_MM) ** 2
    person_count = 0
    for person in range(crowd.people.shape[0]):
        dx, dy = crowd.people[person, 0] - x, crowd.people[person, 1] - y
        if dx * dx + dy * dy < limit:
            bases.person_buffer[person_count] = person
            person_count += 1
    return NearCounts(wall_count, robot_count, person_count)


@inlined
def _hull_half(heading: float, dx: float, dy: float) -> int:
    """Return the half of the hull in the direction (dx, dy): 0 the front, 1 the rear."""
    angle = math.radians(heading)
    return 0 if dy * math.cos(angle) - dx * math.sin(angle) >= 0.0 else 1


@inlined
def _update_bumpers(
    robot: int, bases: Bases, walls: Floats2, crowd: Crowd, counts: NearCounts, radius: float
) -> None:
    """Set the front and rear bumper of a robot; a contact presses the bumper of its half of the hull.

    A contact counts as a bump if there was none before.
    """
    before = bases.contacts[robot, 0] or bases.contacts[robot, 1]
    bases.contacts[robot, 0] = bases.contacts[robot, 1] = False
    x, y, heading = bases.poses[robot, 0], bases.poses[robot, 1], bases.poses[robot, 2]
    for wall in bases.wall_buffer[: counts.walls]:
        dx, dy = _wall_vector(walls, wall, x, y)
        if math.hypot(dx, dy) < radius + SKIN_MM:
            bases.contacts[robot, _hull_half(heading, dx, dy)] = True
    for other in bases.robot_buffer[: counts.robots]:
        dx, dy = bases.poses[other, 0] - x, bases.poses[other, 1] - y
        if math.hypot(dx, dy) < radius + bases.radii[other] + SKIN_MM:
            bases.contacts[robot, _hull_half(heading, dx, dy)] = True
    for person in bases.person_buffer[: counts.people]:
        dx, dy = crowd.people[person, 0] - x, crowd.people[person, 1] - y
        if math.hypot(dx, dy) < radius + crowd.radius + SKIN_MM:
            bases.contacts[robot, _hull_half(heading, dx, dy)] = True
    if (bases.contacts[robot, 0] or bases.contacts[robot, 1]) and not before:
        bases.bumps[robot] += 1
        bases.impacts[robot] = max(bases.impacts[robot], _ground_speed(bases.speeds, robot))


@inlined
def _report(
    robot: int, wheel: int, bases: Bases, slip: float, rolled: float, noise: Floats2, noise_column: int
) -> float:
    """Return what a wheel reports of a distance that it rolled, and add it to its travel."""
    deviate = noise[robot, noise_column + wheel]
    reported: float = rolled * bases.scales[robot, wheel] + slip * math.sqrt(abs(rolled)) * deviate
    bases.travel[robot, wheel] += reported
    return reported


@inlined
def _measured_by_two(
    robot: int, bases: Bases, drive: Drivetrain, ahead: float, turn: float, noise: Floats2, noise_column: int
) -> tuple[float, float, float]:
    """Return a motion as two wheels report it: ahead, to the left, and turn in degrees."""
    half_difference = math.radians(turn) * drive.wheel_base / 2.0
    left = _report(robot, 0, bases, drive.slip, ahead - half_difference, noise, noise_column)
    right = _report(robot, 1, bases, drive.slip, ahead + half_difference, noise, noise_column)
    return (left + right) / 2.0, 0.0, math.degrees((right - left) / drive.wheel_base)


@inlined
def _measured_by_omni_wheels(
    robot: int, bases: Bases, drive: Drivetrain, ahead: float, left: float, turn: float, noise: Floats2,
    noise_column: int,
) -> tuple[float, float, float]:  # fmt: skip
    """Return a motion as wheels report it that also roll sideways: ahead, to the left, turn in degrees."""
    turn = math.radians(turn)
    reported_ahead = reported_left = reported_turn = 0.0
    for wheel in range(int(drive.omni_wheels)):
        rolling, fit = bases.wheels[robot, wheel, 0], bases.wheels[robot, wheel, 1]
        rolled = ahead * rolling[0] + left * rolling[1] + turn * rolling[2]
        reported = _report(robot, wheel, bases, drive.slip, rolled, noise, noise_column)
        reported_ahead += reported * fit[0]
        reported_left += reported * fit[1]
        reported_turn += reported * fit[2]
    return reported_ahead, reported_left, math.degrees(reported_turn)


@inlined
def _update_odometry(
    robot: int, bases: Bases, drive: Drivetrain, ahead: float, left: float, turn: float, noise: Floats2,
    noise_column: int,
) -> None:  # fmt: skip
    """Update a robot's odometry with its wheels' reports of a motion."""
    if drive.omni_wheels > 0.0:
        ahead, left, odometry_turn = _measured_by_omni_wheels(
            robot, bases, drive, ahead, left, turn, noise, noise_column
        )
    else:
        ahead, left, odometry_turn = _measured_by_two(robot, bases, drive, ahead, turn, noise, noise_column)
    dx, dy = _arc(bases.odometry[robot, 2], ahead, left, odometry_turn)
    bases.odometry[robot, 0] += dx
    bases.odometry[robot, 1] += dy
    bases.odometry[robot, 2] = (bases.odometry[robot, 2] + odometry_turn) % 360.0


@compiled
def count_wheels(
    robot: int, bases: Bases, drive: Drivetrain, left: float, right: float, noise: Floats2, noise_column: int
) -> None:
    """Update the odometry of a robot with two wheels with their reports.

    Args:
        robot: the number of the robot.
        bases: the bases; changed.
        drive: the parameters of their drivetrain.
        left: the way in mm that the left wheel rolled.
        right: that of the right wheel.
        noise: (robots, k), standard normal numbers.
        noise_column: the column of the left wheel; that of the right wheel is the next.
    """
    turn = math.degrees((right - left) / drive.wheel_base)
    _update_odometry(robot, bases, drive, (left + right) / 2.0, 0.0, turn, noise, noise_column)


@inlined
def _free_fraction(robot: int, bases: Bases, radius: float, walls: Floats2, crowd: Crowd, counts: NearCounts,
          dx: float, dy: float) -> float:  # fmt: skip
    """Return the fraction of the displacement (dx, dy) that a robot can move before it touches anything."""
    x, y = bases.poses[robot, 0], bases.poses[robot, 1]
    free = 1.0
    for wall in bases.wall_buffer[: counts.walls]:
        free = min(free, _free_of_wall(x, y, dx, dy, walls, wall, radius))
    for other in bases.robot_buffer[: counts.robots]:
        ox, oy = bases.poses[other, 0] - x, bases.poses[other, 1] - y
        free = min(free, _free_of_hull(ox, oy, dx, dy, radius + bases.radii[other]))
    for person in bases.person_buffer[: counts.people]:
        ox, oy = crowd.people[person, 0] - x, crowd.people[person, 1] - y
        free = min(free, _free_of_hull(ox, oy, dx, dy, radius + crowd.radius))
    return free


@inlined
def _move_slice(
    robot: int, bases: Bases, drive: Drivetrain, walls: Floats2, crowd: Crowd, counts: NearCounts, dt: float,
    noise: Floats2, noise_column: int,
) -> None:  # fmt: skip
    """Move one robot for `dt` seconds."""
    speeds, commands, poses = bases.speeds, bases.commands, bases.poses
    speeds[robot, 0] = _approach(speeds[robot, 0], commands[robot, 0], drive.acceleration * dt)
    speeds[robot, 1] = _approach(speeds[robot, 1], commands[robot, 1], drive.turn_acceleration * dt)
    speeds[robot, 2] = _approach(speeds[robot, 2], commands[robot, 2], drive.sideways_acceleration * dt)
    ahead, turn, left = speeds[robot, 0] * dt, speeds[robot, 1] * dt, speeds[robot, 2] * dt
    x, y, heading = poses[robot, 0], poses[robot, 1], poses[robot, 2]
    dx, dy = _arc(heading, ahead, left, turn)
    free = _free_fraction(robot, bases, drive.radius, walls, crowd, counts, dx, dy)
    if free < 1.0:
        bases.impacts[robot] = max(bases.impacts[robot], _ground_speed(speeds, robot))
        speeds[robot, 0] = speeds[robot, 2] = 0.0
        ahead *= free
        left *= free
    poses[robot, 0], poses[robot, 1] = x + free * dx, y + free * dy
    poses[robot, 2] = (heading + turn) % 360.0
    bases.distances[robot] += math.hypot(ahead, left)
    _update_odometry(robot, bases, drive, ahead, left, turn, noise, noise_column)
    if counts.walls + counts.robots + counts.people > 0:
        _update_bumpers(robot, bases, walls, crowd, counts, drive.radius)


@inlined
def _drivetrain_of(robot: int, drivetrains: Floats2) -> Drivetrain:
    """Return the drivetrain of a robot, from the table of all."""
    row = drivetrains[robot]
    return Drivetrain(row[0], row[1], row[2], row[3], row[4], row[5], row[6])


@called
def move(
    bases: Bases, drivetrains: Floats2, walls: Floats2, boxes: Floats2, crowd: Crowd, noise: Floats2,
    noise_column: int, slices: int, time_s: float,
) -> None:  # fmt: skip
    """Move all robots for `time_s` seconds, one after the other, in slices of equal length.

    Args:
        bases: the bases; changed.
        drivetrains: (robots, fields), the parameters of their drivetrains, as in `Drivetrain`.
        walls: the walls, from `wall_table`.
        boxes: their boxes, from `wall_boxes`.
        crowd: the people, which stand still meanwhile.
        noise: (robots, k), standard normal numbers, one per slice and wheel.
        noise_column: the first column of `noise` for the wheels.
        slices: number of slices.
        time_s: the time in seconds.
    """
    counts = NearCounts(0, 0, 0)
    for robot in range(bases.poses.shape[0]):
        drive = _drivetrain_of(robot, drivetrains)
        fastest = math.hypot(
            max(abs(bases.speeds[robot, 0]), abs(bases.commands[robot, 0])),
            max(abs(bases.speeds[robot, 2]), abs(bases.commands[robot, 2])),
        )
        counts = _gather(robot, bases, walls, boxes, crowd, fastest * time_s, drive.radius)
        for index in range(slices):
            column = noise_column + bases.scales.shape[1] * index
            _move_slice(robot, bases, drive, walls, crowd, counts, time_s / slices, noise, column)
    if bases.poses.shape[0] > 1:  # robots that moved later may touch robots that moved before
        for robot in range(bases.poses.shape[0]):
            counts = _gather(robot, bases, walls, boxes, crowd, 0.0, bases.radii[robot])
            _update_bumpers(robot, bases, walls, crowd, counts, bases.radii[robot])
    elif counts.walls + counts.people == 0:  # nothing is near, so that no slice looked at the bumpers
        bases.contacts[:] = False
