"""What the 24 sonars and infrared detectors of each robot see.

A transducer hears in a cone. The cone is filled with rays, a fixed angle apart; each ray ends at the first
thing that it meets, and whether that thing is *heard* is a second question:

- A wall is a mirror for ultrasound. Met within the critical angle to its normal it is heard, beyond that it
  sends the sound away: the ray is silent, but still hides what is behind.
- A corner of two walls at right angles sends the sound back where it came from, by two bounces: it is
  heard from everywhere in front of it.
- Another robot is heard from everywhere.

The reading is the nearest thing heard by a ray of the cone, and the full range where there is none. Rays are
exact (they start at the transducer), so that a wall straight ahead of a transducer is read exactly; a wall
whose nearest point lies between two rays is read too far by less than 0.04 %, and something thin and far away
may be missed between two of them.

Everything happens in the robot's frame: u ahead, v to the left, so that the rays are a constant table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from colony.sim.compiled import Bools, Floats, Ints, compiled, inlined
from colony.sim.config import AHEAD, CHANNELS, SPACING_DEG, RobotConfig

RAY_STEP_DEG = 3.0
"""The angle between neighboring rays of a cone; the axis is always one."""

_RETRO_COSINE = math.sin(math.radians(10.0))  # corners count as right angles up to ten degrees
_NOTHING = -1
_ROBOT = -2
_EDGE = 1e-9  # rays meet walls up to this part beyond their ends: no leak where two walls meet


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RayTable:
    """The rays of a robot in its frame, u ahead and v to the left.

    Attributes:
        origin_u, origin_v: (24,), the transducers in mm.
        ray_u, ray_v: (24, rays), unit vectors; the middle one is the axis.
        half_beam_deg: the largest angle between a ray and its axis.
    """

    origin_u: Floats
    origin_v: Floats
    ray_u: Floats
    ray_v: Floats
    half_beam_deg: float

    @classmethod
    def of(cls, config: RobotConfig) -> RayTable:
        """The rays of a robot."""
        on_a_side = int(config.sonar_half_beam_deg / RAY_STEP_DEG + 1e-9)
        axes = np.radians((np.arange(CHANNELS) - AHEAD) * SPACING_DEG)
        offsets = np.radians(np.arange(-on_a_side, on_a_side + 1) * RAY_STEP_DEG)
        angles = axes[:, None] + offsets[None, :]
        return cls(
            origin_u=config.sonar_ring_mm * np.cos(axes),
            origin_v=config.sonar_ring_mm * np.sin(axes),
            ray_u=np.cos(angles),
            ray_v=np.sin(angles),
            half_beam_deg=on_a_side * RAY_STEP_DEG,
        )


def wall_table(walls: Floats) -> Floats:
    """Walls as the compiled functions take them.

    Args:
        walls: (n, 4), x0, y0, x1, y1 in mm; none without length.

    Returns:
        (n, 7): the same, the unit vector from the first end to the second, and the length.
    """
    along = walls[:, 2:] - walls[:, :2]
    lengths = np.hypot(along[:, 0], along[:, 1])[:, None]
    return np.ascontiguousarray(np.hstack([walls, along / lengths, lengths]))


def corner_reflectors(walls: Floats) -> Bools:
    """Which ends of walls are corners that send sound back, seen from which side.

    Args:
        walls: (n, 7), as `wall_table` gives them.

    Returns:
        (n, 4) bool: start seen from the left of the wall, end from the left, start from the right, end from
        the right.
    """
    reflectors = np.zeros((len(walls), 4), dtype=np.bool_)
    meeting: dict[tuple[int, int], list[tuple[int, int, float, float]]] = {}
    for i, (x0, y0, x1, y1, u, v, _) in enumerate(walls.tolist()):
        meeting.setdefault((round(x0), round(y0)), []).append((i, 0, u, v))
        meeting.setdefault((round(x1), round(y1)), []).append((i, 1, -u, -v))
    for ends in meeting.values():
        for wall, end, u, v in ends:
            for other, _, other_u, other_v in ends:
                if other != wall and abs(u * other_u + v * other_v) <= _RETRO_COSINE:
                    on_left = (u * other_v - v * other_u > 0) == (end == 0)
                    reflectors[wall, end + (0 if on_left else 2)] = True
    return reflectors


@inlined
def _cones(low: float, high: float, half_beam: float) -> tuple[int, int]:
    """The first transducer whose cone meets the bearings from low to high (rad), and how many do.

    What is in the cone of a transducer is, seen from the robot's center, even closer to its axis.
    """
    spacing = 2.0 * math.pi / CHANNELS
    first = math.ceil((low - half_beam) / spacing - 1e-6)
    last = math.floor((high + half_beam) / spacing + 1e-6)
    return (first + AHEAD + CHANNELS) % CHANNELS, min(last - first + 1, CHANNELS)


@inlined
def _cast_at_wall(
    wall: int,
    u0: float,
    v0: float,
    u1: float,
    v1: float,
    start: float,
    end: float,
    origin_u: Floats,
    origin_v: Floats,
    ray_u: Floats,
    ray_v: Floats,
    half_beam: float,
    depth: Floats,
    target: Ints,
) -> None:
    """Let one wall, its ends and their bearings in the robot's frame, stop the rays that reach it first."""
    low, high = min(start, end), max(start, end)
    if high - low > math.pi:
        low, high = high, low + 2.0 * math.pi
    channel, count = _cones(low, high, half_beam)
    eu, ev = u1 - u0, v1 - v0
    for _ in range(count):
        au, av = u0 - origin_u[channel], v0 - origin_v[channel]
        height = au * ev - av * eu
        side = 1.0 if height >= 0.0 else -1.0  # which end is to the left does not matter
        height *= side
        seu, sev, sau, sav = side * eu, side * ev, side * au, side * av
        for ray in range(ray_u.shape[1]):  # without branches, so that the compiler makes vectors of it
            du, dv = ray_u[channel, ray], ray_v[channel, ray]
            across = du * sev - dv * seu
            along = sau * dv - sav * du
            before = depth[channel, ray]
            first = (across > 0.0) & (height < before * across)
            first &= (along >= -_EDGE * across) & (along <= (1.0 + _EDGE) * across)
            depth[channel, ray] = height / across if first else before
            target[channel, ray] = wall if first else target[channel, ray]
        channel = 0 if channel == CHANNELS - 1 else channel + 1


@inlined
def _cast_at_robot(
    u: float,
    v: float,
    radius: float,
    origin_u: Floats,
    origin_v: Floats,
    ray_u: Floats,
    ray_v: Floats,
    half_beam: float,
    deepest: Floats,
    depth: Floats,
    target: Ints,
) -> None:
    """Let another robot at (u, v) stop the rays that reach it first.

    `deepest` is, for each cone, how far any ray of it goes so far.
    """
    # The arc sine of up to one half (hulls do not overlap) is less than pi / 3 times as much.
    bearing, half_width = math.atan2(v, u), math.pi / 3.0 * radius / math.sqrt(u * u + v * v)
    channel, count = _cones(bearing - half_width, bearing + half_width, half_beam)
    for _ in range(count):
        cu, cv = u - origin_u[channel], v - origin_v[channel]
        distance_squared = cu * cu + cv * cv
        if distance_squared < (deepest[channel] + radius) * (deepest[channel] + radius):
            for ray in range(ray_u.shape[1]):
                ahead = cu * ray_u[channel, ray] + cv * ray_v[channel, ray]
                under_root = ahead * ahead - distance_squared + radius * radius
                if ahead > 0.0 and under_root > 0.0:
                    reach = max(ahead - math.sqrt(under_root), 0.0)
                    if reach < depth[channel, ray]:
                        depth[channel, ray] = reach
                        target[channel, ray] = _ROBOT
        channel = 0 if channel == CHANNELS - 1 else channel + 1


@inlined
def _wall_echo(
    x: float,
    y: float,
    dx: float,
    dy: float,
    reach: float,
    wall: int,
    walls: Floats,
    reflectors: Bools,
    cos_critical: float,
    half_step: float,
) -> float:
    """How far away a wall is heard by a ray from (x, y) that meets it after `reach`; infinity if it is not.

    All in the world's frame; (dx, dy) is the ray's direction.
    """
    wx, wy = walls[wall, 4], walls[wall, 5]
    cosine = abs(dx * wy - dy * wx)
    if cosine >= cos_critical:
        return reach
    # A corner is heard by the ray that passes closest to it: less than half a step away.
    near = reach * half_step
    sx, sy = x - walls[wall, 0], y - walls[wall, 1]
    from_start = sx * wx + sy * wy + reach * (dx * wx + dy * wy)
    seen_from = 0 if wx * sy - wy * sx > 0.0 else 2
    if from_start * cosine <= near and reflectors[wall, seen_from]:
        return math.hypot(sx, sy)
    if (walls[wall, 6] - from_start) * cosine <= near and reflectors[wall, seen_from + 1]:
        return math.hypot(walls[wall, 2] - x, walls[wall, 3] - y)
    return math.inf


@inlined
def _meet_walls(
    x: float,
    y: float,
    sine: float,
    cosine: float,
    limit: float,
    walls: Floats,
    origin_u: Floats,
    origin_v: Floats,
    ray_u: Floats,
    ray_v: Floats,
    half_beam: float,
    depth: Floats,
    target: Ints,
) -> None:
    """Find how far the rays of a robot go, at most `limit`, and which wall stops them."""
    for channel in range(CHANNELS):
        for ray in range(ray_u.shape[1]):
            depth[channel, ray] = limit
            target[channel, ray] = _NOTHING
    last_x = last_y = math.nan
    last_bearing = 0.0
    farthest = (limit + origin_u[AHEAD]) ** 2
    for wall in range(walls.shape[0]):
        x0, y0, x1, y1 = walls[wall, 0] - x, walls[wall, 1] - y, walls[wall, 2] - x, walls[wall, 3] - y
        part = min(max(-(x0 * walls[wall, 4] + y0 * walls[wall, 5]), 0.0), walls[wall, 6])
        if (x0 + part * walls[wall, 4]) ** 2 + (y0 + part * walls[wall, 5]) ** 2 >= farthest:
            continue
        u0, v0 = y0 * cosine - x0 * sine, -x0 * cosine - y0 * sine
        u1, v1 = y1 * cosine - x1 * sine, -x1 * cosine - y1 * sine
        # Walls usually go on where the last one ended.
        start = last_bearing if x0 == last_x and y0 == last_y else math.atan2(v0, u0)
        last_x, last_y, last_bearing = x1, y1, math.atan2(v1, u1)
        _cast_at_wall(
            wall, u0, v0, u1, v1, start, last_bearing,
            origin_u, origin_v, ray_u, ray_v, half_beam, depth, target,
        )  # fmt: skip


@inlined
def _meet_robots(
    robot: int,
    poses: Floats,
    sine: float,
    cosine: float,
    limit: float,
    radius: float,
    origin_u: Floats,
    origin_v: Floats,
    ray_u: Floats,
    ray_v: Floats,
    half_beam: float,
    deepest: Floats,
    depth: Floats,
    target: Ints,
) -> None:
    """Stop the rays of a robot where they meet another one."""
    for channel in range(CHANNELS):
        deepest[channel] = depth[channel].max()
    farthest = (limit + origin_u[AHEAD] + radius) ** 2
    for other in range(poses.shape[0]):
        dx, dy = poses[other, 0] - poses[robot, 0], poses[other, 1] - poses[robot, 1]
        if other != robot and dx * dx + dy * dy < farthest:
            u, v = dy * cosine - dx * sine, -dx * cosine - dy * sine
            _cast_at_robot(u, v, radius, origin_u, origin_v, ray_u, ray_v, half_beam, deepest, depth, target)


@inlined
def _listen(
    robot: int,
    poses: Floats,
    sine: float,
    cosine: float,
    limit: float,
    walls: Floats,
    reflectors: Bools,
    origin_u: Floats,
    origin_v: Floats,
    ray_u: Floats,
    ray_v: Floats,
    cos_critical: float,
    half_step: float,
    depth: Floats,
    target: Ints,
    echoes: Floats,
) -> None:
    """Fill `echoes` with the nearest thing that each transducer of a robot hears, at most `limit`."""
    for channel in range(CHANNELS):
        u, v = origin_u[channel], origin_v[channel]
        x, y = poses[robot, 0] - u * sine - v * cosine, poses[robot, 1] + u * cosine - v * sine
        nearest = limit
        for ray in range(ray_u.shape[1]):
            reach, met = depth[channel, ray], target[channel, ray]
            if reach < nearest and met == _ROBOT:
                nearest = reach
            elif reach < nearest:
                u, v = ray_u[channel, ray], ray_v[channel, ray]
                dx, dy = -u * sine - v * cosine, u * cosine - v * sine
                echo = _wall_echo(x, y, dx, dy, reach, met, walls, reflectors, cos_critical, half_step)
                nearest = min(nearest, echo)
        echoes[robot, channel] = nearest


@compiled(
    "void(f8[:,::1], f8[:,::1], b1[:,::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8, f8, f8, f8, f8,"
    " f8[::1], f8[:,::1], i8[:,::1], f8[:,::1], f8[:,::1])"
)
def sense(
    poses: Floats,
    walls: Floats,
    reflectors: Bools,
    origin_u: Floats,
    origin_v: Floats,
    ray_u: Floats,
    ray_v: Floats,
    radius: float,
    limit: float,
    half_beam: float,
    cos_critical: float,
    half_step: float,
    deepest: Floats,
    depth: Floats,
    target: Ints,
    echoes: Floats,
    axis_depths: Floats,
) -> None:
    """Cast the rays of all robots and listen to what they meet.

    Args:
        poses: (robots, 3), x and y in mm, heading in degrees.
        walls: (n, 7) and reflectors: (n, 4), as `wall_table` and `corner_reflectors` give them.
        origin_u, origin_v, ray_u, ray_v: as in `RayTable`.
        radius: of the robots, in mm.
        limit: the full range, in mm.
        half_beam: the largest angle between a ray and its axis, in radians.
        cos_critical: the cosine of the critical angle.
        half_step: the tangent of half the angle between rays.
        deepest, depth, target: (24,), (24, rays) and (24, rays), room to work in.
        echoes: (robots, 24), gets the nearest thing heard, in mm from the transducer.
        axis_depths: (robots, 24), gets the nearest thing on the axis, heard or not, in mm.
    """
    for robot in range(poses.shape[0]):
        x, y, heading = poses[robot, 0], poses[robot, 1], math.radians(poses[robot, 2])
        sine, cosine = math.sin(heading), math.cos(heading)
        _meet_walls(
            x, y, sine, cosine, limit, walls, origin_u, origin_v, ray_u, ray_v, half_beam, depth, target
        )
        if poses.shape[0] > 1:
            _meet_robots(
                robot, poses, sine, cosine, limit, radius,
                origin_u, origin_v, ray_u, ray_v, half_beam, deepest, depth, target,
            )  # fmt: skip
        _listen(
            robot, poses, sine, cosine, limit, walls, reflectors, origin_u, origin_v, ray_u, ray_v,
            cos_critical, half_step, depth, target, echoes,
        )  # fmt: skip
        axis_depths[robot] = depth[:, ray_u.shape[1] // 2]
