"""The beams of laser scanners and range finders, cast at walls, robots and people.

Beams are thin rays from the scanner, in its own frame: u ahead of the robot, v to the left of it. Each ends
at the first thing that it hits.

A wall fills an interval of bearings, and only the beams in it are computed. Along a beam (du, dv) the
reciprocal of the distance to a straight line is linear in du and dv. So the kernel keeps the greatest
reciprocal for each beam, its **nearness**, without a division or a branch for each beam and wall.

The noise of a beam is a hash of the scan and of the beam (`colony.sim.chance`), which chooses an entry in a
table of normal quantiles; other bits of it decide whether the echo is lost.

A range finder with a cone is a narrow scanner, which gives the nearest of its rays alone.
"""

from __future__ import annotations

import math
from functools import cache
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from colony.sim.chance import BEAMS, random_bits
from colony.sim.compiled import Floats, Floats2, Ints, compiled, inlined
from colony.sim.world.placing import GROUP, HIGH_X, HIGH_Y, IS_OUTLINE, LOW_X, LOW_Y, box_gap

DROPOUT_BITS = 50
"""Bits of the hash that decide on a dropout: the probability is a multiple of 2 ** -50."""

_QUANTILES = 1 << 12
_WITHIN_RAD = 1e-9  # tolerance of the bearings of a wall's ends, so that beams do not leak between walls
_NARROW_RAD = 1e-4  # interval in which the tolerance could make a wall, seen from its end, appear nearer
_TOUCHING = 1e9  # nearness inside of a hull
_ROUGH_RAD = 0.005
_NEAR_MM = 3000.0  # walls up to this distance are looked at first
_SHORT = 0.2  # a wall is short if it is at most this fraction of its distance


U, V, IS_CAST = range(3)
"""Rows of the table of beams, in the order of their bearings: unit vectors, and 1 for a beam that can see
anything, 0 for one that the robot's body blocks."""


class LidarModel(NamedTuple):
    """A laser scanner on a robot; lengths in mm, angles in rad.

    Attributes:
        u, v: its place, ahead of the robot's center and to the left of it.
        first: the lowest bearing of the beams.
        density: the number of beams in a radian.
        full_range: the longest range.
        noise: standard deviation of a range.
        dropouts: probability that a beam has no echo, times 2 ** DROPOUT_BITS.
        person: the radius of people.
    """

    u: float
    v: float
    first: float
    density: float
    full_range: float
    noise: float
    dropouts: int
    person: float


@cache
def normal_quantiles() -> Floats:
    """Return equally likely values of a standard normal variable, (4096,)."""
    normal = NormalDist()
    half = [normal.inv_cdf((i + 0.5) / _QUANTILES) for i in range(_QUANTILES // 2)]
    lower = np.array(half)
    return np.concatenate([lower, -lower[::-1]])


@inlined
def _beams_within(low: float, width: float, model: LidarModel, count: int) -> tuple[int, int, int]:
    """Return the beams whose bearings are in an interval: the first to the second, and 0 to the third.

    Both ends are included; there is none if the end is below the begin.
    """
    turn = 2.0 * math.pi
    begin = low - model.first
    begin -= math.floor(begin * (1.0 / turn)) * turn
    begin, end = (begin - _WITHIN_RAD) * model.density, (begin + width + _WITHIN_RAD) * model.density
    first, last, again = math.ceil(begin), math.floor(end), math.floor(end - turn * model.density)
    return first, min(last, count - 1), min(again, count - 1)


@inlined
def _raise_to_line(
    first: int, last: int, a: float, b: float, most: float, beams: Floats2, nearness: Floats
) -> None:
    """Raise the nearness of beams to that of a line, a * u + b * v, at most `most`."""
    if last >= first:
        u, v, highest = beams[U, first : last + 1], beams[V, first : last + 1], nearness[first : last + 1]
        for i in range(highest.shape[0]):  # without branches, so that the compiler vectorizes it
            near = min(u[i] * a + v[i] * b, most)
            highest[i] = near if near > highest[i] else highest[i]


@inlined
def _rough_bearing(u: float, v: float) -> float:
    """Return the bearing of (u, v) within `_ROUGH_RAD`, in less time than the arc tangent takes."""
    across, ahead = abs(v), abs(u)
    ratio = min(across, ahead) / max(across, ahead)
    bearing = ratio * (0.97239411 - 0.19194795 * ratio * ratio)
    bearing = math.pi / 2.0 - bearing if across > ahead else bearing
    bearing = math.pi - bearing if u < 0.0 else bearing
    return -bearing if v < 0.0 else bearing


@inlined
def _cast_at_short_outline(
    x0: float, y0: float, x1: float, y1: float, height: float, length: float, gap: float, sine: float,
    cosine: float, model: LidarModel, beams: Floats2, nearness: Floats,
) -> None:  # fmt: skip
    """Raise the nearness of the beams that hit a short wall whose left side is not seen.

    Beams around its middle are looked at one by one, which takes less time than the bearings of its ends.

    Args:
        x0: x of its begin, from the scanner, in the world's frame.
        y0: y of its begin.
        x1: x of its end.
        y1: y of its end.
        height: x0 * y1 - y0 * x1, below 0.
        length: its length, at most `_SHORT` of its distance.
        gap: the square of its distance.
        sine: that of the robot's heading.
        cosine: that of the robot's heading.
        model: the scanner.
        beams: its beams.
        nearness: their nearness; raised.
    """
    u0, v0 = y0 * cosine - x0 * sine, -x0 * cosine - y0 * sine
    u1, v1 = y1 * cosine - x1 * sine, -x1 * cosine - y1 * sine
    most = 1.0 / math.sqrt(gap)
    half_width = 0.505 * length * most + _ROUGH_RAD  # at least the arc sine of half the length
    low = _rough_bearing(0.5 * (u0 + u1), 0.5 * (v0 + v1)) - half_width
    first, last, again = _beams_within(low, 2.0 * half_width, model, nearness.shape[0])
    begin_tolerance, end_tolerance = _WITHIN_RAD * (abs(u0) + abs(v0)), _WITHIN_RAD * (abs(u1) + abs(v1))
    for part in range(2):
        for i in range(first if part == 0 else 0, (last if part == 0 else again) + 1):
            du, dv = beams[U, i], beams[V, i]
            if (
                nearness[i] < most
                and du * v0 - dv * u0 >= -begin_tolerance
                and u1 * dv - v1 * du >= -end_tolerance
            ):
                a, b = (v1 - v0) / height, (u0 - u1) / height
                nearness[i] = max(nearness[i], min(du * a + dv * b, most))


@inlined
def _seen(first: int, last: int, most: float, nearness: Floats) -> int:
    """Return the number of beams that do not end before a distance, whose reciprocal is `most`."""
    seen = 0
    if last >= first:
        part = nearness[first : last + 1]
        for i in range(part.shape[0]):  # without branches, so that the compiler vectorizes it
            seen += 1 if part[i] < most else 0
    return seen


@inlined
def _is_hidden(
    boxes: Floats2, group: int, gap: float, x: float, y: float, sine: float, cosine: float, model: LidarModel,
    nearness: Floats,
) -> bool:  # fmt: skip
    """Return True if all beams toward a box end before it; `gap` is the square of its distance, above 0."""
    across, up = boxes[group, HIGH_X] - boxes[group, LOW_X], boxes[group, HIGH_Y] - boxes[group, LOW_Y]
    dx, dy = boxes[group, LOW_X] + 0.5 * across - x, boxes[group, LOW_Y] + 0.5 * up - y
    ratio = 0.5 * math.sqrt((across * across + up * up) / (dx * dx + dy * dy))
    hidden = ratio < 1.0
    if hidden:
        half_width = ratio + 0.5708 * ratio * ratio * ratio + _ROUGH_RAD  # at least the arc sine
        low = _rough_bearing(dy * cosine - dx * sine, -dx * cosine - dy * sine) - half_width
        first, last, again = _beams_within(low, 2.0 * half_width, model, nearness.shape[0])
        most = 1.0 / math.sqrt(gap)
        hidden = _seen(first, last, most, nearness) + _seen(0, again, most, nearness) == 0
    return hidden


@inlined
def _cast_at_walls(
    x: float, y: float, sine: float, cosine: float, walls: Floats2, boxes: Floats2, model: LidarModel,
    beams: Floats2, nearness: Floats,
) -> None:  # fmt: skip
    """Set the nearness of all beams of a scanner at (x, y): that of the first wall, or 0."""
    count = nearness.shape[0]
    nearness[:] = 0.0
    last_x = last_y = math.nan
    last_bearing = 0.0
    farthest = model.full_range * model.full_range
    gaps = np.empty(boxes.shape[0])
    for group in range(boxes.shape[0]):  # without branches, so that the compiler vectorizes it
        gaps[group] = box_gap(boxes, group, x, y)
    for is_far in range(2):  # first what is near, which hides much of the rest
        for group in range(boxes.shape[0]):
            is_outline = boxes[group, IS_OUTLINE] != 0.0
            is_turn = (1 if is_outline and gaps[group] > _NEAR_MM * _NEAR_MM else 0) == is_far
            if (
                gaps[group] < farthest
                and is_turn
                and not (
                    is_far == 1 and _is_hidden(boxes, group, gaps[group], x, y, sine, cosine, model, nearness)
                )
            ):
                for wall in range(group * GROUP, min((group + 1) * GROUP, walls.shape[0])):
                    x0, y0, x1, y1 = (
                        walls[wall, 0] - x,
                        walls[wall, 1] - y,
                        walls[wall, 2] - x,
                        walls[wall, 3] - y,
                    )
                    along = min(max(-(x0 * walls[wall, 4] + y0 * walls[wall, 5]), 0.0), walls[wall, 6])
                    gap = (x0 + along * walls[wall, 4]) ** 2 + (y0 + along * walls[wall, 5]) ** 2
                    cross = x0 * y1 - y0 * x1  # below 0 on the right side
                    is_short = is_outline and walls[wall, 6] * walls[wall, 6] < _SHORT * _SHORT * gap
                    if gap < farthest and is_short and cross < 0.0:
                        _cast_at_short_outline(
                            x0, y0, x1, y1, cross, walls[wall, 6], gap, sine, cosine, model, beams, nearness
                        )
                    elif gap < farthest and (cross < 0.0 or not is_outline):
                        u0, v0 = y0 * cosine - x0 * sine, -x0 * cosine - y0 * sine
                        u1, v1 = y1 * cosine - x1 * sine, -x1 * cosine - y1 * sine
                        # Walls usually start at the end of the previous one.
                        start = last_bearing if x0 == last_x and y0 == last_y else math.atan2(v0, u0)
                        end = math.atan2(v1, u1)
                        last_x, last_y, last_bearing = x1, y1, end
                        height = u0 * v1 - v0 * u1
                        low, width = (start, end - start) if height > 0.0 else (end, start - end)
                        width += 2.0 * math.pi if width < 0.0 else 0.0
                        if height != 0.0 and width <= math.pi + _WITHIN_RAD:
                            a, b = (v1 - v0) / height, (u0 - u1) / height
                            most = math.inf if width > _NARROW_RAD else 1.0 / math.sqrt(gap)
                            first, last, again = _beams_within(low, width, model, count)
                            _raise_to_line(first, last, a, b, most, beams, nearness)
                            _raise_to_line(0, again, a, b, most, beams, nearness)


@inlined
def _raise_to_hull(
    first: int, last: int, u: float, v: float, tangent: float, most: float, beams: Floats2, nearness: Floats
) -> None:
    """Raise the nearness of the beams that hit a hull at (u, v).

    `tangent` is the square of the distance to the points where beams touch it, and `most` the nearness of
    its nearest point.
    """
    for i in range(first, last + 1):
        if nearness[i] < most:
            ahead = u * beams[U, i] + v * beams[V, i]
            under_root = ahead * ahead - tangent
            if ahead > 0.0 and under_root >= 0.0:
                # The product of the distances to the two points where a beam crosses a circle is `tangent`.
                nearness[i] = max(nearness[i], (ahead + math.sqrt(under_root)) / tangent)


@inlined
def _cast_at_hull(
    u: float, v: float, radius: float, model: LidarModel, beams: Floats2, nearness: Floats
) -> None:
    """Raise the nearness of the beams that hit a robot or a person at (u, v)."""
    squared = u * u + v * v
    tangent = squared - radius * radius
    if tangent <= 0.0:
        nearness[:] = _TOUCHING
    elif squared < (model.full_range + radius) ** 2:
        distance = math.sqrt(squared)
        sine, most = radius / distance, 1.0 / (distance - radius)
        half_width = sine + 0.5708 * sine * sine * sine + _ROUGH_RAD  # at least the arc sine
        low = _rough_bearing(u, v) - half_width
        first, last, again = _beams_within(low, 2.0 * half_width, model, nearness.shape[0])
        _raise_to_hull(first, last, u, v, tangent, most, beams, nearness)
        _raise_to_hull(0, again, u, v, tangent, most, beams, nearness)


@inlined
def _cast(
    poses: Floats2, radii: Floats, people: Floats2, walls: Floats2, boxes: Floats2, robot: int,
    model: LidarModel,
    beams: Floats2, nearness: Floats,
) -> None:  # fmt: skip
    """Set the nearness of all beams of one robot's scanner: that of walls, other robots and people."""
    heading = math.radians(poses[robot, 2])
    sine, cosine = math.sin(heading), math.cos(heading)
    x = poses[robot, 0] - model.u * sine - model.v * cosine
    y = poses[robot, 1] + model.u * cosine - model.v * sine
    _cast_at_walls(x, y, sine, cosine, walls, boxes, model, beams, nearness)
    for other in range(poses.shape[0]):
        dx, dy = poses[other, 0] - x, poses[other, 1] - y
        if other != robot and dx * dx + dy * dy < (model.full_range + radii[other]) ** 2:
            u, v = dy * cosine - dx * sine, -dx * cosine - dy * sine
            _cast_at_hull(u, v, radii[other], model, beams, nearness)
    for person in range(people.shape[0]):
        dx, dy = people[person, 0] - x, people[person, 1] - y
        u, v = dy * cosine - dx * sine, -dx * cosine - dy * sine
        _cast_at_hull(u, v, model.person, model, beams, nearness)


@inlined
def _measured(near: float, bits: np.uint64, model: LidarModel, noise: float, quantiles: Floats) -> float:
    """Return the range that is measured of what has this nearness: infinity if there is no echo."""
    reading = 1.0 / near
    spread = model.noise + noise * reading
    reading += spread * quantiles[bits & np.uint64(_QUANTILES - 1)]
    reading = min(max(reading, 0.0), model.full_range)
    has_echo = (near >= 1.0 / model.full_range) & (
        (bits >> np.uint64(64 - DROPOUT_BITS)) >= np.uint64(model.dropouts)
    )
    return reading if has_echo else math.inf


@inlined
def _scan_one(
    poses: Floats2, radii: Floats, people: Floats2, walls: Floats2, boxes: Floats2, robot: int,
    event: int, seed: int, model: LidarModel, beams: Floats2, quantiles: Floats, ranges: Floats,
) -> None:  # fmt: skip
    """Cast all beams of one robot's scanner; see `scan`."""
    _cast(poses, radii, people, walls, boxes, robot, model, beams, ranges)
    for i in range(ranges.shape[0]):
        bits = random_bits(seed, BEAMS, event, i)
        ranges[i] = _measured(ranges[i] * beams[IS_CAST, i], bits, model, 0.0, quantiles)


@compiled
def read(
    distances: Floats, event: int, seed: int, model: LidarModel, quantiles: Floats, ranges: Floats
) -> None:
    """Read the beams of a scanner that something else has cast.

    Args:
        distances: (beams,), the distances in mm to what each beam hits; infinity if it hits nothing.
        event: the number of the scan, for its noise.
        seed: the seed of the noise.
        model: the scanner; only its range and its noise count.
        quantiles: the table of `normal_quantiles`.
        ranges: (beams,), receives the ranges in mm; infinity for a beam without an echo.
    """
    for i in range(ranges.shape[0]):
        bits = random_bits(seed, BEAMS, event, i)
        ranges[i] = _measured(1.0 / distances[i], bits, model, 0.0, quantiles)


@compiled
def scan(
    poses: Floats2, radii: Floats, people: Floats2, walls: Floats2, boxes: Floats2, members: Ints,
    robots: Ints, seeds: Ints,
    event: int, model: LidarModel, beams: Floats2, quantiles: Floats, ranges: Floats2,
) -> None:  # fmt: skip
    """Cast all beams of several equal scanners.

    Args:
        poses: (robots, 3), x and y in mm, heading in degrees.
        radii: (robots,), the radii of their hulls.
        people: (people, 2), x and y in mm.
        walls: (n, 7), the walls that light detects, from `wall_table`.
        boxes: their boxes, from `wall_boxes`.
        members: the numbers of the scanners that scan.
        robots: (scanners,), the number of the robot of each scanner.
        seeds: (scanners,), the seed of the noise of each scanner.
        event: the number of the scan, for its noise.
        model: the scanners.
        beams: (3, beams), their beams.
        quantiles: the table of `normal_quantiles`.
        ranges: (scanners, beams), receives the ranges in mm; infinity for a beam without an echo.
    """
    for member in members:
        _scan_one(
            poses, radii, people, walls, boxes, robots[member], event, seeds[member], model, beams, quantiles,
            ranges[member],
        )  # fmt: skip


@compiled
def find_ranges(
    poses: Floats2, radii: Floats, people: Floats2, walls: Floats2, boxes: Floats2, robot: int, event: int,
    seed: int,
    model: LidarModel, nearest: float, noise_fraction: float, cones: Floats2, rays: Floats2,
    quantiles: Floats, nearness: Floats, ranges: Floats,
) -> None:  # fmt: skip
    """Measure with several single range finders of a robot, each of which sees the nearest ray of a cone.

    Args:
        poses: (robots, 3), x and y in mm, heading in degrees.
        radii: (robots,), the radii of their hulls.
        people: (people, 2), x and y in mm.
        walls: (n, 7), the walls that light detects, from `wall_table`.
        boxes: their boxes, from `wall_boxes`.
        robot: the number of the robot.
        event: the number of the measurement, for its noise.
        seed: the seed of the noise.
        model: the range finders, each a scanner of its cone; their places and first rays are in `cones`.
        nearest: the smallest reading, in mm.
        noise_fraction: what is added to the standard deviation of a range, as a fraction of it.
        cones: (range finders, 3), place ahead of the robot's center and to the left of it, in mm, and the
            bearing of the first ray, in rad.
        rays: (3 * range finders, rays), the table of beams of each cone.
        quantiles: the table of `normal_quantiles`.
        nearness: (rays,), work space.
        ranges: (range finders,), receives the ranges in mm; infinity for one without an echo.
    """
    for cone in range(cones.shape[0]):
        scanner = LidarModel(
            cones[cone, 0], cones[cone, 1], cones[cone, 2], model.density, model.full_range, model.noise,
            model.dropouts, model.person,
        )  # fmt: skip
        _cast(poses, radii, people, walls, boxes, robot, scanner, rays[3 * cone : 3 * cone + 3], nearness)
        near = 0.0
        for i in range(nearness.shape[0]):
            near = max(near, nearness[i])
        bits = random_bits(seed, BEAMS, event, cone)
        ranges[cone] = max(_measured(near, bits, model, noise_fraction, quantiles), nearest)
