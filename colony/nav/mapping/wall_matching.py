"""Matches the lines of a local map to the walls of the building, to determine the error of the robot's pose.

A line matches a wall if it is nearly parallel to it, not far from it, beside it for a good part of its
length, and if the robot is on the wall's free side. So the line of an open door, which is at an angle, and
that of the back wall of a room, which is too far away, match no wall. Two walls along a hallway give the
heading and the position across it; a wall ahead, in a turning space or at a hallway's end, also gives the
position along it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from colony.nav.mapping.local_map import WallLine
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.echoes import Bools, Floats, Reflectors


def wrap_deg(angle_deg: float) -> float:
    """Wrap an angle to (-180, 180]."""
    return 180.0 - (180.0 - angle_deg) % 360.0


class WallCandidate(NamedTuple):
    """A line of a local map, transformed to the frame of the building by the estimated pose.

    The ends are in mm, x east and y north; `weight` is the sum of the certainties of the line's cells,
    `spread_mm` the standard deviation of the cells across the line.
    """

    x0_mm: float
    y0_mm: float
    x1_mm: float
    y1_mm: float
    weight: float
    spread_mm: float

    @property
    def length_mm(self) -> float:
        """Length of the line."""
        return math.hypot(self.x1_mm - self.x0_mm, self.y1_mm - self.y0_mm)


def in_building_frame(line: WallLine, origin: Pose) -> WallCandidate:
    """Return a line of the local map that began at `origin`, in the frame of the building."""
    angle = math.radians(line.angle_deg)
    cosine, sine = math.cos(angle), math.sin(angle)
    heading = math.radians(origin.heading_deg)
    east, north = -math.sin(heading), math.cos(heading)
    ends: list[float] = []
    for along in (line.begin_mm, line.end_mm):
        ahead = cosine * along - sine * line.distance_mm
        left = sine * along + cosine * line.distance_mm
        ends += [origin.x_mm + ahead * east - left * north, origin.y_mm + ahead * north + left * east]
    return WallCandidate(ends[0], ends[1], ends[2], ends[3], line.weight, line.spread_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class Gate:
    """The limits within which a line matches a wall.

    Attributes:
        angle_deg, offset_mm: maximum angle and maximum distance between the line and the wall.
        min_overlap: minimum fraction of the line's length that is beside the wall.
    """

    angle_deg: float = 15.0
    offset_mm: float = 700.0
    min_overlap: float = 0.5


DEFAULT_GATE = Gate()


class WallMatch(NamedTuple):
    """A line matched to a wall.

    Attributes:
        turn_deg: correction of the heading that makes the line parallel to the wall.
        shift_mm: subsequent correction of the position, along the wall's normal, away from the wall.
        normal_x, normal_y: the normal, a unit vector.
        turn_sd_deg, shift_sd_mm: standard deviations of both corrections.
    """

    turn_deg: float
    shift_mm: float
    normal_x: float
    normal_y: float
    turn_sd_deg: float
    shift_sd_mm: float


_SAME_WALL_MM = 60.0
_SAME_WALL_DEG = 2.0
_MIN_SPREAD_MM = 20.0
_INDEPENDENT_CELLS = 4.0
"""Number of independent cells assumed for a line's fit: one reading affects several cells."""


def match_wall(
    candidate: WallCandidate, walls: Reflectors, robot: Pose, gate: Gate = DEFAULT_GATE
) -> WallMatch | None:
    """Match a line to one of the walls near the robot's estimated pose; None without a match.

    Collinear pieces of wall, and doors between them, count as one wall; walls that may return no echo do not
    count.
    """
    length = candidate.length_mm
    if length == 0.0 or len(walls.length) == 0:
        return None
    turn, offset, overlap, facing = _compare(candidate, walls, robot)
    is_candidate = (np.abs(turn) <= gate.angle_deg) & (np.abs(offset) <= gate.offset_mm)
    is_candidate &= facing & (overlap > 0.0) & np.isfinite(walls.sigma_factor)
    best, max_overlap = -1, gate.min_overlap * length
    for i in np.flatnonzero(is_candidate).tolist():
        same_wall = np.abs(offset - offset[i]) <= _SAME_WALL_MM
        same_wall &= is_candidate & (np.abs(turn - turn[i]) <= _SAME_WALL_DEG)
        if (total := float(overlap[same_wall].sum())) > max_overlap:
            best, max_overlap = i, total
    if best < 0:
        return None
    spread = max(candidate.spread_mm, _MIN_SPREAD_MM) / math.sqrt(_INDEPENDENT_CELLS)
    return WallMatch(
        turn_deg=float(turn[best]),
        shift_mm=-float(offset[best]),
        normal_x=float(walls.normal[best, 0]),
        normal_y=float(walls.normal[best, 1]),
        # The cells are spread evenly over the line: their standard deviation along it is length / sqrt(12).
        turn_sd_deg=math.degrees(spread * math.sqrt(12.0) / length),
        shift_sd_mm=spread,
    )


def _compare(
    candidate: WallCandidate, walls: Reflectors, robot: Pose
) -> tuple[Floats, Floats, Floats, Bools]:
    """Compare a line with each wall.

    Returns:
        The turn about the robot that makes the line parallel to the wall, in degrees; after this turn, the
        offset of the line into the free space and its length beside the wall, in mm; and True where both the
        wall and the line face the robot.
    """
    length = candidate.length_mm
    along_x = (candidate.x1_mm - candidate.x0_mm) / length
    along_y = (candidate.y1_mm - candidate.y0_mm) / length
    cross = along_x * walls.along[:, 1] - along_y * walls.along[:, 0]
    dot = along_x * walls.along[:, 0] + along_y * walls.along[:, 1]
    turn = np.arctan2(np.where(dot < 0.0, -cross, cross), np.abs(dot))
    x = (candidate.x0_mm + candidate.x1_mm) / 2.0 - robot.x_mm
    y = (candidate.y0_mm + candidate.y1_mm) / 2.0 - robot.y_mm
    cosine, sine = np.cos(turn), np.sin(turn)
    to_robot = np.array([robot.x_mm, robot.y_mm]) - walls.start
    to_center = to_robot + np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
    offset = (to_center * walls.normal).sum(axis=1)
    center_along = (to_center * walls.along).sum(axis=1)
    overlap = np.minimum(center_along + length / 2.0, walls.length) - np.maximum(
        center_along - length / 2.0, 0.0
    )
    height = (to_robot * walls.normal).sum(axis=1)
    return np.degrees(turn), offset, overlap, (height > 0.0) & (height > offset)


class PoseCorrection(NamedTuple):
    """The correction to add to a pose, in mm and degrees; the heading's has a standard deviation."""

    x_mm: float
    y_mm: float
    heading_deg: float
    heading_sd_deg: float


_AGREEMENT_DEG = 4.0


def combine_matches(matches: tuple[WallMatch, ...]) -> PoseCorrection | None:
    """Combine the matches of several walls; None without matches.

    Matches whose heading disagrees with that of the most accurate match are left out. The position is only
    corrected along the normals of the matched walls.
    """
    if not matches:
        return None
    most_accurate = min(matches, key=lambda match: match.turn_sd_deg)
    agreeing = [m for m in matches if abs(wrap_deg(m.turn_deg - most_accurate.turn_deg)) <= _AGREEMENT_DEG]
    weights = [1.0 / m.turn_sd_deg**2 for m in agreeing]
    turn = sum(w * m.turn_deg for w, m in zip(weights, agreeing, strict=True)) / sum(weights)
    information, vector = np.zeros((2, 2)), np.zeros(2)
    for m in agreeing:
        normal = np.array([m.normal_x, m.normal_y])
        information += np.outer(normal, normal) / m.shift_sd_mm**2
        vector += normal * (m.shift_mm / m.shift_sd_mm**2)
    shift = np.linalg.pinv(information, rcond=1e-3) @ vector
    return PoseCorrection(
        x_mm=float(shift[0]),
        y_mm=float(shift[1]),
        heading_deg=turn,
        heading_sd_deg=1.0 / math.sqrt(sum(weights)),
    )
