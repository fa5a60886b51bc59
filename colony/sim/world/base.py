"""The motion of the robots' bases: two wheels, limited acceleration, a round hull stopped by obstacles.

A step is divided into slices of at most twenty milliseconds. In each slice the speeds approach the commands
within the acceleration limits, and the robot drives an exact arc. If the arc would end inside a wall or
another robot, the base goes as far as possible and its wheels stall; it can still turn and drive away. The
distance per slice is much shorter than the hull, so robots never jump over obstacles. Within a step the
robots move one after the other.

Odometry integrates the wheels' reports with the same arcs. Each wheel has its own scale error, and random
errors whose variance grows with the distance.

Positions are in mm, headings in degrees counterclockwise from north, speeds in mm/s and degrees/s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from colony.sim.compiled import Bools2, Floats, Floats2, Ints, compiled, inlined
from colony.sim.world.people import Crowd

SLICE_S = 0.02
"""Largest time in seconds over which speeds are considered constant."""

_SKIN_MM = 1.0  # distance from the hull that counts as contact
_BISECTIONS = 40


class Bases(NamedTuple):
    """The state of all robots, one row each, with work space.

    Attributes:
        poses, odometry: (robots, 3), x, y, heading.
        speeds, commands: (robots, 2), ahead and turning.
        scales: (robots, 2), scale factors of the left and the right wheel.
        distances: (robots,), distances driven so far.
        contacts: (robots, 2), front and rear bumper.
        bumps: (robots,), number of collisions so far.
        impacts: (robots,), largest speed in a collision so far.
        wall_buffer, robot_buffer, person_buffer: (walls,), (robots,), (people,), indices of nearby objects.
    """

    poses: Floats2
    odometry: Floats2
    speeds: Floats2
    commands: Floats2
    scales: Floats2
    distances: Floats
    contacts: Bools2
    bumps: Ints
    impacts: Floats
    wall_buffer: Ints
    robot_buffer: Ints
    person_buffer: Ints


def bases_at(poses: Floats2, scales: Floats2) -> Bases:
    """Return bases that stand at `poses`, (robots, 3), with the same odometry, and empty work space."""
    count = len(poses)
    return Bases(
        poses=poses,
        odometry=poses.copy(),
        speeds=np.zeros((count, 2)),
        commands=np.zeros((count, 2)),
        scales=scales,
        distances=np.zeros(count),
        contacts=np.zeros((count, 2), dtype=np.bool_),
        bumps=np.zeros(count, dtype=np.int64),
        impacts=np.zeros(count),
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
    """The parameters of a drivetrain, as in `RobotConfig`; `slip` is in mm per square root of a mm."""

    radius: float
    wheel_base: float
    acceleration: float
    turn_acceleration: float
    slip: float


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
    """Return `speed`, changed toward `wanted` by at most `limit`."""
    return speed + min(max(target - speed, -limit), limit)


@inlined
def _arc(heading: float, distance: float, turn: float) -> tuple[float, float]:
    """Return the displacement along an arc of length `distance` that turns by `turn` degrees."""
    half = math.radians(turn) / 2.0
    chord = distance * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    along = math.radians(heading) + half
    return -math.sin(along) * chord, math.cos(along) * chord


@inlined
def _free_of_wall(
    x: float, y: float, dx: float, dy: float, walls: Floats2, wall: int, radius: float
) -> float:
    """Return the fraction of (dx, dy) that a hull at (x, y) can move before it touches a wall.

    If the hull is already in the wall, only motion toward the wall is stopped.
    """
    before = _wall_distance(walls, wall, x, y)
    after = _wall_distance(walls, wall, x + dx, y + dy)
    free = 1.0
    if after < radius and after < before:
        free, high = 0.0, 1.0
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
    free = 1.0
    if after < min_distance and after < before:
        free, high = 0.0, 1.0
        for _ in range(_BISECTIONS if before > min_distance else 0):
            middle = (free + high) / 2.0
            if math.hypot(ox - middle * dx, oy - middle * dy) < min_distance:
                high = middle
            else:
                free = middle
    return free


@inlined
def _gather(
    robot: int, bases: Bases, walls: Floats2, crowd: Crowd, distance: float, radius: float
) -> NearCounts:
    """Collect everything that a robot may touch within `distance` in the work space; return the counts."""
    x, y = bases.poses[robot, 0], bases.poses[robot, 1]
    limit = (radius + distance + _SKIN_MM) ** 2
    wall_count = 0
    for wall in range(walls.shape[0]):
        dx, dy = _wall_vector(walls, wall, x, y)
        if dx * dx + dy * dy < limit:
            bases.wall_buffer[wall_count] = wall
            wall_count += 1
    limit = (2.0 * radius + distance + _SKIN_MM) ** 2
    robot_count = 0
    for other in range(bases.poses.shape[0]):
        dx, dy = bases.poses[other, 0] - x, bases.poses[other, 1] - y
        if dx * dx + dy * dy < limit and other != robot:
            bases.robot_buffer[robot_count] = other
            robot_count += 1
    limit = (radius + crowd.radius + distance + _SKIN_MM) ** 2
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
        if math.hypot(dx, dy) < radius + _SKIN_MM:
            bases.contacts[robot, _hull_half(heading, dx, dy)] = True
    for other in bases.robot_buffer[: counts.robots]:
        dx, dy = bases.poses[other, 0] - x, bases.poses[other, 1] - y
        if math.hypot(dx, dy) < 2.0 * radius + _SKIN_MM:
            bases.contacts[robot, _hull_half(heading, dx, dy)] = True
    for person in bases.person_buffer[: counts.people]:
        dx, dy = crowd.people[person, 0] - x, crowd.people[person, 1] - y
        if math.hypot(dx, dy) < radius + crowd.radius + _SKIN_MM:
            bases.contacts[robot, _hull_half(heading, dx, dy)] = True
    if (bases.contacts[robot, 0] or bases.contacts[robot, 1]) and not before:
        bases.bumps[robot] += 1
        bases.impacts[robot] = max(bases.impacts[robot], abs(bases.speeds[robot, 0]))


@inlined
def _update_odometry(
    robot: int,
    bases: Bases,
    drive: Drivetrain,
    distance: float,
    turn: float,
    left_noise: float,
    right_noise: float,
) -> None:
    """Update a robot's odometry with its wheels' reports of a motion."""
    half_difference = math.radians(turn) * drive.wheel_base / 2.0
    left, right = distance - half_difference, distance + half_difference
    left = left * bases.scales[robot, 0] + drive.slip * math.sqrt(abs(left)) * left_noise
    right = right * bases.scales[robot, 1] + drive.slip * math.sqrt(abs(right)) * right_noise
    odometry_turn = math.degrees((right - left) / drive.wheel_base)
    dx, dy = _arc(bases.odometry[robot, 2], (left + right) / 2.0, odometry_turn)
    bases.odometry[robot, 0] += dx
    bases.odometry[robot, 1] += dy
    bases.odometry[robot, 2] = (bases.odometry[robot, 2] + odometry_turn) % 360.0


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
        free = min(free, _free_of_hull(ox, oy, dx, dy, 2.0 * radius))
    for person in bases.person_buffer[: counts.people]:
        ox, oy = crowd.people[person, 0] - x, crowd.people[person, 1] - y
        free = min(free, _free_of_hull(ox, oy, dx, dy, radius + crowd.radius))
    return free


@inlined
def _move_slice(
    robot: int, bases: Bases, drive: Drivetrain, walls: Floats2, crowd: Crowd, counts: NearCounts, dt: float,
    left_noise: float, right_noise: float,
) -> None:  # fmt: skip
    """Move one robot for `dt` seconds."""
    speeds, commands, poses = bases.speeds, bases.commands, bases.poses
    speeds[robot, 0] = _approach(speeds[robot, 0], commands[robot, 0], drive.acceleration * dt)
    speeds[robot, 1] = _approach(speeds[robot, 1], commands[robot, 1], drive.turn_acceleration * dt)
    distance, turn = speeds[robot, 0] * dt, speeds[robot, 1] * dt
    x, y, heading = poses[robot, 0], poses[robot, 1], poses[robot, 2]
    dx, dy = _arc(heading, distance, turn)
    free = _free_fraction(robot, bases, drive.radius, walls, crowd, counts, dx, dy)
    if free < 1.0:
        bases.impacts[robot] = max(bases.impacts[robot], abs(speeds[robot, 0]))
        speeds[robot, 0] = 0.0
        distance *= free
    poses[robot, 0], poses[robot, 1] = x + free * dx, y + free * dy
    poses[robot, 2] = (heading + turn) % 360.0
    bases.distances[robot] += abs(distance)
    _update_odometry(robot, bases, drive, distance, turn, left_noise, right_noise)
    if counts.walls + counts.robots + counts.people > 0:
        _update_bumpers(robot, bases, walls, crowd, counts, drive.radius)


@compiled
def move(
    bases: Bases, drive: Drivetrain, walls: Floats2, crowd: Crowd, noise: Floats2, noise_column: int, slices:
        int,
    time_s: float,
) -> None:  # fmt: skip
    """Move all robots for `time_s` seconds, one after the other, in slices of equal length.

    Args:
        bases: the bases; changed.
        drive: the parameters of their drivetrain.
        walls: the walls, from `wall_table`.
        crowd: the people, which stand still meanwhile.
        noise: (robots, k), standard normal numbers, two per slice for the wheels.
        noise_column: the first column of `noise` for the wheels.
        slices: number of slices.
        time_s: the time in seconds.
    """
    for robot in range(bases.poses.shape[0]):
        fastest = max(abs(bases.speeds[robot, 0]), abs(bases.commands[robot, 0]))
        counts = _gather(robot, bases, walls, crowd, fastest * time_s, drive.radius)
        for index in range(slices):
            left, right = noise[robot, noise_column + 2 * index], noise[robot, noise_column + 2 * index + 1]
            _move_slice(robot, bases, drive, walls, crowd, counts, time_s / slices, left, right)
    for robot in range(bases.poses.shape[0]):  # robots that moved later may touch robots that moved before
        counts = _gather(robot, bases, walls, crowd, 0.0, drive.radius)
        _update_bumpers(robot, bases, walls, crowd, counts, drive.radius)
