"""The ring of sonars and infrared detectors of each robot.

The beam of a transducer is a cone of evenly spaced rays, two of them on its edges. Each ray stops at the
first obstacle that it hits. The obstacle may return an echo or not:

- A wall is a mirror for ultrasound. Within the critical angle to its normal it returns an echo; beyond, it
  reflects the sound away, but still hides everything behind it.
- A corner of two walls at right angles is a retroreflector: it returns an echo in all directions in front.
- Another robot or a person returns an echo in all directions.

The reading is the nearest echo of the cone's rays, or the full range without an echo. Rays start at the
transducer, so that a wall straight ahead is read exactly. The range of a wall whose nearest point lies
between two rays is too long by less than 0.04 %, and thin, distant objects between two rays may be missed.

Computations use the robot's frame: u ahead, v to the left, so that the rays are a constant table.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.sim.chance import CROSS_TALK, uniform
from colony.sim.compiled import Bools2, Floats, Floats2, Ints, Ints2, compiled, inlined
from colony.sim.config import RingConfig
from colony.sim.hazards.scenery import CompassDisturbance
from colony.sim.world.people import Crowd
from colony.sim.world.placing import GROUP, box_gap

# --- sonar ---------------------------------------------------------------------------------------------


RAY_STEP_DEG = 3.0
"""Largest angle between neighboring rays of a cone; one ray is always on the axis."""

_RETRO_COSINE = math.sin(math.radians(10.0))  # tolerance of right angles: ten degrees
_NOTHING = -1
_HULL = -2  # of a robot or a person
_MIN_FALSE_MM = 300.0
_EDGE = 1e-9  # fraction by which walls extend beyond their ends, so that rays do not leak between them


class Fan(NamedTuple):
    """The rays of a robot in its frame, u ahead and v to the left, with work space.

    Attributes:
        origin_u, origin_v: (channels,), the transducers in mm.
        ray_u, ray_v: (channels, rays), unit vectors; the ray in the middle is the axis of the cone.
        depth: (channels, rays), the length of each ray in mm.
        target: (channels, rays), the obstacle that each ray hits: the index of a wall, a hull, or nothing.
        deepest: (channels,), the greatest depth of each cone.
    """

    origin_u: Floats
    origin_v: Floats
    ray_u: Floats2
    ray_v: Floats2
    depth: Floats2
    target: Ints2
    deepest: Floats


class ProximityModel(NamedTuple):
    """The model of a robot's sonars and infrared detectors, from its `RingConfig`.

    `ahead` is the channel that looks straight ahead, `spacing_rad` the angle between neighbors.
    """

    ahead: int
    spacing_rad: float
    full_range: float
    min_range: float
    half_beam_rad: float
    cos_critical: float
    tan_half_step: float
    noise_mm: float
    noise_fraction: float
    infrared_range: float


class CrossTalk(NamedTuple):
    """Cross-talk of sonars.

    Attributes:
        probability: the probability that a reading is false.
        seed: the seed.
        channels: the largest number of channels of a robot.
    """

    probability: float
    seed: int
    channels: int


def _rays_of(ring: RingConfig) -> tuple[int, float]:
    """Return the number of rays on either side of a cone's axis, and the angle between them in degrees."""
    rays_per_side = math.ceil(ring.sonar_half_beam_deg / RAY_STEP_DEG - 1e-9)
    return rays_per_side, ring.sonar_half_beam_deg / rays_per_side if rays_per_side else RAY_STEP_DEG


def fan_of(ring: RingConfig) -> Fan:
    """Return the rays of a robot with this ring."""
    rays_per_side, step_deg = _rays_of(ring)
    axes = np.radians((np.arange(ring.channels) - ring.ahead) * ring.spacing_deg)
    offsets = np.radians(np.arange(-rays_per_side, rays_per_side + 1) * step_deg)
    angles = axes[:, None] + offsets[None, :]
    return Fan(
        origin_u=ring.ring_mm * np.cos(axes),
        origin_v=ring.ring_mm * np.sin(axes),
        ray_u=np.cos(angles),
        ray_v=np.sin(angles),
        depth=np.empty(angles.shape),
        target=np.empty(angles.shape, dtype=np.int64),
        deepest=np.empty(ring.channels),
    )


def proximity_model(ring: RingConfig) -> ProximityModel:
    """Return the model of the sonars and infrared detectors of robots with this ring."""
    return ProximityModel(
        ahead=ring.ahead,
        spacing_rad=2.0 * math.pi / ring.channels,
        full_range=ring.sonar_range_mm,
        min_range=ring.sonar_min_mm,
        half_beam_rad=math.radians(ring.sonar_half_beam_deg),
        cos_critical=math.cos(math.radians(ring.sonar_critical_deg)),
        tan_half_step=math.tan(math.radians(_rays_of(ring)[1] / 2)),
        noise_mm=ring.sonar_noise_mm,
        noise_fraction=ring.sonar_noise,
        infrared_range=ring.infrared_range_mm,
    )


def wall_table(walls: Floats2) -> Floats2:
    """Return walls in the form of the compiled functions.

    Args:
        walls: (n, 4), x0, y0, x1, y1 in mm; none of length 0.

    Returns:
        (n, 7): the walls, the unit vectors from the first end to the second, and the lengths.
    """
    along = walls[:, 2:] - walls[:, :2]
    lengths = np.hypot(along[:, 0], along[:, 1])[:, None]
    return np.ascontiguousarray(np.hstack([walls, along / lengths, lengths]))


def corner_reflectors(walls: Floats2) -> Bools2:
    """Return a mask of the ends of walls that are retroreflecting corners, by side.

    Args:
        walls: (n, 7), from `wall_table`.

    Returns:
        (n, 4) bool: start seen from the left of the wall, end from the left, start from the right, end from
        the right.
    """
    reflectors = np.zeros((len(walls), 4), dtype=np.bool_)
    ends_at: dict[tuple[int, int], list[tuple[int, int, float, float]]] = {}
    for i, (x0, y0, x1, y1, u, v, _) in enumerate(walls.tolist()):
        ends_at.setdefault((round(x0), round(y0)), []).append((i, 0, u, v))
        ends_at.setdefault((round(x1), round(y1)), []).append((i, 1, -u, -v))
    for ends in ends_at.values():
        for wall, end, u, v in ends:
            for other, _, other_u, other_v in ends:
                if other != wall and abs(u * other_u + v * other_v) <= _RETRO_COSINE:
                    on_left = (u * other_v - v * other_u > 0) == (end == 0)
                    reflectors[wall, end + (0 if on_left else 2)] = True
    return reflectors


@inlined
def _cones(low: float, high: float, model: ProximityModel, channels: int) -> tuple[int, int]:
    """Return the first transducer whose cone overlaps the bearings low to high (rad), and how many do.

    An object in the cone of a transducer is even closer to its axis as seen from the robot's center.
    """
    first = math.ceil((low - model.half_beam_rad) / model.spacing_rad - 1e-6)
    last = math.floor((high + model.half_beam_rad) / model.spacing_rad + 1e-6)
    channel = first + model.ahead
    while channel < 0:
        channel += channels
    while channel >= channels:
        channel -= channels
    return channel, min(last - first + 1, channels)


@inlined
def _cast_at_wall(
    wall: int,
    u0: float,
    v0: float,
    u1: float,
    v1: float,
    start: float,
    end: float,
    model: ProximityModel,
    fan: Fan,
) -> None:
    """Shorten the rays that hit a wall, given by its ends and their bearings in the robot's frame."""
    low, high = min(start, end), max(start, end)
    if high - low > math.pi:
        low, high = high, low + 2.0 * math.pi
    channels = fan.origin_u.shape[0]
    channel, count = _cones(low, high, model, channels)
    eu, ev = u1 - u0, v1 - v0
    for _ in range(count):
        au, av = u0 - fan.origin_u[channel], v0 - fan.origin_v[channel]
        height = au * ev - av * eu
        side = 1.0 if height >= 0.0 else -1.0  # independent of the order of the ends
        height *= side
        seu, sev, sau, sav = side * eu, side * ev, side * au, side * av
        for ray in range(fan.ray_u.shape[1]):  # without branches, so that the compiler vectorizes it
            du, dv = fan.ray_u[channel, ray], fan.ray_v[channel, ray]
            across = du * sev - dv * seu
            along = sau * dv - sav * du
            before = fan.depth[channel, ray]
            is_nearer = (across > 0.0) & (height < before * across)
            is_nearer &= (along >= -_EDGE * across) & (along <= (1.0 + _EDGE) * across)
            fan.depth[channel, ray] = height / across if is_nearer else before
            fan.target[channel, ray] = wall if is_nearer else fan.target[channel, ray]
        channel = 0 if channel == channels - 1 else channel + 1


@inlined
def _cast_at_hull(u: float, v: float, radius: float, model: ProximityModel, fan: Fan) -> None:
    """Shorten the rays that hit a robot or a person at (u, v)."""
    # The arc sine of up to one half (hulls do not overlap) is less than pi / 3 times as much.
    bearing, half_width = math.atan2(v, u), math.pi / 3.0 * radius / math.sqrt(u * u + v * v)
    channels = fan.origin_u.shape[0]
    channel, count = _cones(bearing - half_width, bearing + half_width, model, channels)
    for _ in range(count):
        cu, cv = u - fan.origin_u[channel], v - fan.origin_v[channel]
        distance_squared = cu * cu + cv * cv
        if distance_squared < (fan.deepest[channel] + radius) * (fan.deepest[channel] + radius):
            for ray in range(fan.ray_u.shape[1]):  # without branches, as above
                ahead = cu * fan.ray_u[channel, ray] + cv * fan.ray_v[channel, ray]
                under_root = ahead * ahead - distance_squared + radius * radius
                distance = max(ahead - math.sqrt(max(under_root, 0.0)), 0.0)
                before = fan.depth[channel, ray]
                is_nearer = (ahead > 0.0) & (under_root > 0.0) & (distance < before)
                fan.depth[channel, ray] = distance if is_nearer else before
                fan.target[channel, ray] = _HULL if is_nearer else fan.target[channel, ray]
        channel = 0 if channel == channels - 1 else channel + 1


@inlined
def _cast_at_all_walls(
    x: float, y: float, sine: float, cosine: float, walls: Floats2, boxes: Floats2, model: ProximityModel,
    fan: Fan,
) -> None:  # fmt: skip
    """Set the depths of a robot's rays, at most the full range, and the walls that they hit."""
    for channel in range(fan.depth.shape[0]):
        for ray in range(fan.ray_u.shape[1]):
            fan.depth[channel, ray] = model.full_range
            fan.target[channel, ray] = _NOTHING
    last_x = last_y = math.nan
    last_bearing = 0.0
    farthest = (model.full_range + fan.origin_u[model.ahead]) ** 2
    for group in range(boxes.shape[0]):
        if box_gap(boxes, group, x, y) < farthest:
            for wall in range(group * GROUP, min((group + 1) * GROUP, walls.shape[0])):
                x0, y0, x1, y1 = (
                    walls[wall, 0] - x,
                    walls[wall, 1] - y,
                    walls[wall, 2] - x,
                    walls[wall, 3] - y,
                )
                along = min(max(-(x0 * walls[wall, 4] + y0 * walls[wall, 5]), 0.0), walls[wall, 6])
                if (x0 + along * walls[wall, 4]) ** 2 + (y0 + along * walls[wall, 5]) ** 2 < farthest:
                    u0, v0 = y0 * cosine - x0 * sine, -x0 * cosine - y0 * sine
                    u1, v1 = y1 * cosine - x1 * sine, -x1 * cosine - y1 * sine
                    # Walls usually start at the end of the previous one.
                    start = last_bearing if x0 == last_x and y0 == last_y else math.atan2(v0, u0)
                    last_x, last_y, last_bearing = x1, y1, math.atan2(v1, u1)
                    _cast_at_wall(wall, u0, v0, u1, v1, start, last_bearing, model, fan)


@inlined
def _cast_at_all_hulls(
    robot: int, poses: Floats2, radii: Floats, sine: float, cosine: float, crowd: Crowd,
    model: ProximityModel, fan: Fan,
) -> None:  # fmt: skip
    """Shorten the rays of a robot that hit another robot or a person."""
    for channel in range(fan.depth.shape[0]):
        fan.deepest[channel] = fan.depth[channel].max()
    robots = poses.shape[0]
    for other in range(robots + crowd.people.shape[0]):
        hull = poses[other] if other < robots else crowd.people[other - robots]
        radius = radii[other] if other < robots else crowd.radius
        dx, dy = hull[0] - poses[robot, 0], hull[1] - poses[robot, 1]
        if (
            other != robot
            and dx * dx + dy * dy < (model.full_range + fan.origin_u[model.ahead] + radius) ** 2
        ):
            u, v = dy * cosine - dx * sine, -dx * cosine - dy * sine
            _cast_at_hull(u, v, radius, model, fan)


@inlined
def _wall_echo(
    x: float, y: float, dx: float, dy: float, distance: float, wall: int, walls: Floats2, reflectors: Bools2,
    model: ProximityModel,
) -> float:  # fmt: skip
    """Return the distance of a wall's echo on a ray from (x, y) that hits it after `distance`, or infinity.

    Coordinates are in the world's frame; (dx, dy) is the ray's direction.
    """
    wx, wy = walls[wall, 4], walls[wall, 5]
    cosine = abs(dx * wy - dy * wx)
    echo = math.inf
    if cosine >= model.cos_critical:
        echo = distance
    else:  # only the ray closest to a corner, less than half a step away, gets its echo
        tolerance = distance * model.tan_half_step
        sx, sy = x - walls[wall, 0], y - walls[wall, 1]
        from_start = sx * wx + sy * wy + distance * (dx * wx + dy * wy)
        side_column = 0 if wx * sy - wy * sx > 0.0 else 2
        if from_start * cosine <= tolerance and reflectors[wall, side_column]:
            echo = math.hypot(sx, sy)
        elif (walls[wall, 6] - from_start) * cosine <= tolerance and reflectors[wall, side_column + 1]:
            echo = math.hypot(walls[wall, 2] - x, walls[wall, 3] - y)
    return echo


@inlined
def _nearest_echo(
    channel: int, x: float, y: float, sine: float, cosine: float, walls: Floats2, reflectors: Bools2,
    model: ProximityModel, fan: Fan,
) -> float:  # fmt: skip
    """Return the nearest echo at a transducer of a robot at (x, y), at most the full range."""
    u, v = fan.origin_u[channel], fan.origin_v[channel]
    from_x, from_y = x - u * sine - v * cosine, y + u * cosine - v * sine
    nearest = model.full_range
    for ray in range(fan.ray_u.shape[1]):
        distance, target = fan.depth[channel, ray], fan.target[channel, ray]
        if distance < nearest and target == _HULL:
            nearest = distance
        elif distance < nearest:
            u, v = fan.ray_u[channel, ray], fan.ray_v[channel, ray]
            dx, dy = -u * sine - v * cosine, u * cosine - v * sine
            nearest = min(
                nearest, _wall_echo(from_x, from_y, dx, dy, distance, target, walls, reflectors, model)
            )
    return nearest


@inlined
def _with_cross_talk(cross_talk: CrossTalk, step: int, channel: int, reading: float) -> float:
    """Return the reading, or a false one caused by another transducer.

    `channel` counts the channels of all robots.
    """
    if (
        uniform(cross_talk.seed, CROSS_TALK, step, channel) < cross_talk.probability
        and reading > _MIN_FALSE_MM
    ):
        fraction = uniform(cross_talk.seed, CROSS_TALK, step, channel + cross_talk.channels)
        reading = _MIN_FALSE_MM + fraction * (reading - _MIN_FALSE_MM)
    return reading


@compiled
def sense(
    poses: Floats2, radii: Floats, members: Ints, walls: Floats2, boxes: Floats2, reflectors: Bools2,
    crowd: Crowd, model: ProximityModel,
    cross_talk: CrossTalk, step: int,
    fan: Fan, noise: Floats2, noise_column: int, sonar: Floats2, infrared: Bools2,
) -> None:  # fmt: skip
    """Cast the rays of all robots with equal rings, and compute their readings.

    Args:
        poses: (robots, 3), x and y in mm, heading in degrees.
        radii: (robots,), the radii of their hulls.
        members: (members,), the numbers of the robots that have this ring.
        walls: the walls from `wall_table`, without silent ones.
        boxes: their boxes, from `wall_boxes`.
        reflectors: the mask from `corner_reflectors`, without silent walls.
        crowd: the people.
        model: the model of the sonars and infrared detectors.
        cross_talk: the cross-talk.
        step: the number of steps so far; cross-talk is independent in each step.
        fan: the rays, and work space.
        noise: (robots, k), standard normal numbers.
        noise_column: the first column of `noise` for the transducers.
        sonar: (members, channels), receives the readings in mm.
        infrared: (members, channels), receives True if there is an obstacle on the axis, with an echo or not.
    """
    channels = fan.origin_u.shape[0]
    for member in range(members.shape[0]):
        robot = members[member]
        x, y, heading = poses[robot, 0], poses[robot, 1], math.radians(poses[robot, 2])
        sine, cosine = math.sin(heading), math.cos(heading)
        _cast_at_all_walls(x, y, sine, cosine, walls, boxes, model, fan)
        if poses.shape[0] + crowd.people.shape[0] > 1:
            _cast_at_all_hulls(robot, poses, radii, sine, cosine, crowd, model, fan)
        for channel in range(channels):
            reading = _nearest_echo(channel, x, y, sine, cosine, walls, reflectors, model, fan)
            if reading < model.full_range:
                reading += noise[robot, noise_column + channel] * (
                    model.noise_mm + model.noise_fraction * reading
                )
                reading = min(max(reading, model.min_range), model.full_range)
            if cross_talk.probability > 0.0:
                number = channel + 2 * cross_talk.channels * robot
                reading = _with_cross_talk(cross_talk, step, number, reading)
            sonar[member, channel] = reading
            infrared[member, channel] = fan.depth[channel, fan.ray_u.shape[1] // 2] <= model.infrared_range


# --- rings ---------------------------------------------------------------------------------------------
#
# Equal rings of sonars and infrared detectors of robots of a world, measured once a step.


# --- compass ------------------------------------------------------------------------------------------
#
# The compass, disturbed by iron in the building (thesis Figure 6.2).
#
# The disturbance is gridded noise: each corner of a grid has a random value, with smooth interpolation in
# between, so that the disturbance is bounded and continuous (Perlin 1985).

_MASK = 2**64 - 1


def disturbance_deg(field: CompassDisturbance, x_mm: float, y_mm: float) -> float:
    """Return the error of a compass at a position, in degrees, at most `field.max_deg`."""
    if field.max_deg == 0.0:
        return 0.0
    column, row = (
        math.floor(x_mm / field.spacing_mm),
        math.floor(y_mm / field.spacing_mm),
    )
    east = _smooth(x_mm / field.spacing_mm - column)
    north = _smooth(y_mm / field.spacing_mm - row)
    south_side = _blend(
        _corner(field.seed, column, row),
        _corner(field.seed, column + 1, row),
        east,
    )
    north_side = _blend(
        _corner(field.seed, column, row + 1),
        _corner(field.seed, column + 1, row + 1),
        east,
    )
    return field.max_deg * _blend(south_side, north_side, north)


def _corner(seed: int, column: int, row: int) -> float:
    """Return the value of a corner of the grid, in [-1, 1); splitmix64, as in `colony.sim.chance`."""
    bits = (seed * 0x9E3779B97F4A7C15 + column * 0xD1B54A32D192ED03 + row * 0x8CB92BA72F3D8DD7) & _MASK
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        bits = ((bits ^ (bits >> shift)) * factor) & _MASK
    return ((bits ^ (bits >> 31)) >> 11) * 2.0**-52 - 1.0


def _smooth(fraction: float) -> float:
    return fraction * fraction * (3.0 - 2.0 * fraction)


def _blend(start: float, end: float, fraction: float) -> float:
    return start + fraction * (end - start)


# --- rings --------------------------------------------------------------------------------------------


class Rings:
    """The equal rings of some robots of a world. Mutable: keeps the readings, valid while `is_measured`.

    The rows of `sonar` and `infrared`, (members, channels), are those of the robots in the order of `robots`.

    Args:
        ring: the ring of each robot.
        robots: the numbers of the robots that have it.
    """

    def __init__(self, ring: RingConfig, robots: Sequence[int]) -> None:
        self._model, self._fan = proximity_model(ring), fan_of(ring)
        self._members = np.array(robots, dtype=np.int64)
        self._unwired = np.setdiff1d(np.arange(ring.channels), ring.infrared_wired)
        self.sonar: NDArray[np.float64] = np.empty((len(robots), ring.channels))
        self.infrared: NDArray[np.bool_] = np.empty((len(robots), ring.channels), dtype=np.bool_)
        self.is_measured = False

    def measure(
        self,
        poses: Floats2,
        radii: Floats,
        walls: Floats2,
        boxes: Floats2,
        reflectors: Bools2,
        crowd: Crowd,
        cross_talk: CrossTalk,
        step: int,
        noise: Floats2,
        noise_column: int,
    ) -> None:
        """Measure with all rings; the arguments are those of `sense`."""
        sense(
            poses,
            radii,
            self._members,
            walls,
            boxes,
            reflectors,
            crowd,
            self._model,
            cross_talk,
            step,
            self._fan,
            noise,
            noise_column,
            self.sonar,
            self.infrared,
        )
        self.infrared[:, self._unwired] = False
        self.is_measured = True
