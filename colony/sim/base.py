"""How the robots' bases move: two wheels, limited acceleration, a round hull that walls and robots stop.

A step is cut into slices of twenty milliseconds at most. In each slice the speeds move toward the command, as
far as the acceleration allows, and the robot drives an exact arc. Where the arc's end would be inside a wall
or another robot, the base goes as far as it can and its wheels stall; it may still turn, and drive away. What
a robot drives in a slice is much shorter than its hull, so nothing is jumped over. Within a step the robots
move one after the other.

Odometry integrates what the wheels report, with the same arcs: each wheel has a scale error of its own and
miscounts at random as it rolls, with a variance that grows with the distance.

Positions are in mm, headings in degrees counterclockwise from north, speeds in mm/s and degrees/s.
"""

from __future__ import annotations

import math

from colony.sim.compiled import Bools, Floats, Ints, compiled, inlined

SLICE_S = 0.02
"""The longest time over which speeds are taken as constant."""

_SKIN_MM = 1.0  # nearer than this to the hull counts as touching it
_BISECTIONS = 40


@inlined
def _wall_distance(
    walls: Floats,
    wall: int,
    x: float,
    y: float,
) -> tuple[float, float, float]:
    """From a point to a wall, and the vector to its nearest point."""
    ax, ay, ex, ey = walls[wall, 0] - x, walls[wall, 1] - y, walls[wall, 4], walls[wall, 5]
    part = min(max(-(ax * ex + ay * ey), 0.0), walls[wall, 6])
    dx, dy = ax + part * ex, ay + part * ey
    return math.sqrt(dx * dx + dy * dy), dx, dy


@inlined
def _approach(speed: float, wanted: float, most: float) -> float:
    """`speed`, changed toward `wanted` by `most` at most."""
    return speed + min(max(wanted - speed, -most), most)


@inlined
def _arc(heading: float, distance: float, turn: float) -> tuple[float, float]:
    """The displacement of a drive over `distance` while the heading changes by `turn` degrees."""
    half = math.radians(turn) / 2.0
    chord = distance * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    along = math.radians(heading) + half
    return -math.sin(along) * chord, math.cos(along) * chord


@inlined
def _free_part(
    x: float,
    y: float,
    dx: float,
    dy: float,
    poses: Floats,
    walls: Floats,
    near_walls: Ints,
    near_robots: Ints,
    radius: float,
) -> float:
    """How much of the way (dx, dy) a hull at (x, y) can go; 1 is all.

    What is already too near stops only what comes nearer to it.
    """
    free = 1.0
    for wall in near_walls:
        before = _wall_distance(walls, wall, x, y)[0]
        after = _wall_distance(walls, wall, x + free * dx, y + free * dy)[0]
        if after < radius and after < before:
            low, high = 0.0, free
            for _ in range(_BISECTIONS if before > radius else 0):
                middle = (low + high) / 2.0
                if _wall_distance(walls, wall, x + middle * dx, y + middle * dy)[0] < radius:
                    high = middle
                else:
                    low = middle
            free = low
    for other in near_robots:
        ox, oy = poses[other, 0] - x, poses[other, 1] - y
        before = math.hypot(ox, oy)
        if math.hypot(ox - free * dx, oy - free * dy) < min(before, 2.0 * radius):
            low, high = 0.0, free
            for _ in range(_BISECTIONS if before > 2.0 * radius else 0):
                middle = (low + high) / 2.0
                if math.hypot(ox - middle * dx, oy - middle * dy) < 2.0 * radius:
                    high = middle
                else:
                    low = middle
            free = low
    return free


@inlined
def _gather(
    robot: int,
    poses: Floats,
    walls: Floats,
    reach: float,
    radius: float,
    wall_room: Ints,
    robot_room: Ints,
) -> tuple[Ints, Ints]:
    """The walls and robots that a robot may touch when it moves by `reach` at most."""
    x, y = poses[robot, 0], poses[robot, 1]
    wall_count = 0
    for wall in range(walls.shape[0]):
        if _wall_distance(walls, wall, x, y)[0] < radius + reach + _SKIN_MM:
            wall_room[wall_count] = wall
            wall_count += 1
    robot_count = 0
    for other in range(poses.shape[0]):
        dx, dy = poses[other, 0] - x, poses[other, 1] - y
        most = 2.0 * radius + reach + _SKIN_MM
        if other != robot and dx * dx + dy * dy < most * most:
            robot_room[robot_count] = other
            robot_count += 1
    return wall_room[:wall_count], robot_room[:robot_count]


@inlined
def _half(heading: float, dx: float, dy: float) -> int:
    """Which half of the hull is in the direction (dx, dy): 0 the front, 1 the rear."""
    angle = math.radians(heading)
    return 0 if dy * math.cos(angle) - dx * math.sin(angle) >= 0.0 else 1


@inlined
def _feel(
    robot: int,
    poses: Floats,
    walls: Floats,
    near_walls: Ints,
    near_robots: Ints,
    radius: float,
    contacts: Bools,
    bumps: Ints,
) -> None:
    """Set the front and rear bumper of a robot: what touches the hull presses the half that it touches.

    Where nothing was touched before, that is a bump.
    """
    before = contacts[robot, 0] or contacts[robot, 1]
    contacts[robot, 0] = contacts[robot, 1] = False
    x, y = poses[robot, 0], poses[robot, 1]
    for wall in near_walls:
        distance, dx, dy = _wall_distance(walls, wall, x, y)
        if distance < radius + _SKIN_MM:
            contacts[robot, _half(poses[robot, 2], dx, dy)] = True
    for other in near_robots:
        dx, dy = poses[other, 0] - x, poses[other, 1] - y
        if math.hypot(dx, dy) < 2.0 * radius + _SKIN_MM:
            contacts[robot, _half(poses[robot, 2], dx, dy)] = True
    if (contacts[robot, 0] or contacts[robot, 1]) and not before:
        bumps[robot] += 1


@inlined
def _count(
    odometry: Floats,
    scales: Floats,
    robot: int,
    distance: float,
    turn: float,
    base: float,
    slip: float,
    left_noise: float,
    right_noise: float,
) -> None:
    """Move an odometry pose by what the wheels report of a drive."""
    half_difference = math.radians(turn) * base / 2.0
    left, right = distance - half_difference, distance + half_difference
    left = left * scales[robot, 0] + slip * math.sqrt(abs(left)) * left_noise
    right = right * scales[robot, 1] + slip * math.sqrt(abs(right)) * right_noise
    counted = math.degrees((right - left) / base)
    dx, dy = _arc(odometry[robot, 2], (left + right) / 2.0, counted)
    odometry[robot, 0] += dx
    odometry[robot, 1] += dy
    odometry[robot, 2] = (odometry[robot, 2] + counted) % 360.0


@compiled(
    "void(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], i8, f8[:,::1], f8[::1],"
    " f8, f8, f8, f8, f8, f8, i8[::1], i8[::1], b1[:,::1], i8[::1])"
)
def move(
    poses: Floats,
    odometry: Floats,
    speeds: Floats,
    commands: Floats,
    scales: Floats,
    noise: Floats,
    slices: int,
    walls: Floats,
    distances: Floats,
    time_s: float,
    radius: float,
    base: float,
    acceleration: float,
    turn_acceleration: float,
    slip: float,
    wall_room: Ints,
    robot_room: Ints,
    contacts: Bools,
    bumps: Ints,
) -> None:
    """Move all robots for `time_s` seconds, one after the other, in slices of equal length.

    Args:
        poses, odometry: (robots, 3), x, y, heading; changed.
        speeds, commands: (robots, 2), ahead and turning; speeds are changed.
        scales: (robots, 2), what the left and the right wheel report of a millimeter.
        noise: (robots, k), standard normal; the last two times `slices` are for the slip of the wheels.
        walls: (n, 7), as `wall_table` gives them.
        distances: (robots,), the way driven so far; changed.
        radius, base: of hull and wheels, in mm; the accelerations in mm/s^2 and degrees/s^2.
        slip: the standard deviation of a wheel's count per square root of a millimeter.
        wall_room, robot_room: (n,) and (robots,), room to work in.
        contacts: (robots, 2), front and rear bumper; changed.
        bumps: (robots,), how often a robot ran into something so far; changed.
    """
    dt = time_s / slices
    first = noise.shape[1] - 2 * slices
    for robot in range(poses.shape[0]):
        fastest = max(abs(speeds[robot, 0]), abs(commands[robot, 0]))
        near = _gather(robot, poses, walls, fastest * time_s, radius, wall_room, robot_room)
        for part in range(slices):
            speeds[robot, 0] = _approach(speeds[robot, 0], commands[robot, 0], acceleration * dt)
            speeds[robot, 1] = _approach(speeds[robot, 1], commands[robot, 1], turn_acceleration * dt)
            way, turn = speeds[robot, 0] * dt, speeds[robot, 1] * dt
            x, y, heading = poses[robot, 0], poses[robot, 1], poses[robot, 2]
            dx, dy = _arc(heading, way, turn)
            free = _free_part(x, y, dx, dy, poses, walls, near[0], near[1], radius)
            if free < 1.0:
                speeds[robot, 0] = 0.0
                way *= free
            poses[robot, 0], poses[robot, 1] = x + free * dx, y + free * dy
            poses[robot, 2] = (heading + turn) % 360.0
            distances[robot] += abs(way)
            z = first + 2 * part
            _count(odometry, scales, robot, way, turn, base, slip, noise[robot, z], noise[robot, z + 1])
            if len(near[0]) + len(near[1]) > 0:
                _feel(robot, poses, walls, near[0], near[1], radius, contacts, bumps)
    for robot in range(poses.shape[0]):  # those that moved later may touch those that moved before
        near = _gather(robot, poses, walls, 0.0, radius, wall_room, robot_room)
        _feel(robot, poses, walls, near[0], near[1], radius, contacts, bumps)
