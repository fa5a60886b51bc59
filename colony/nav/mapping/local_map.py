"""Local sonar maps, with their origin at the robot's initial or current position."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from colony.nav.mapping.himm import Cells, HimmMap, HimmParameters, LocalPose
from colony.nav.pose.echoes import Floats
from colony.nav.pose.pose import OdometryStep

# --- hough --------------------------------------------------------------------------------------------
#
# The Hough transform of a local map: its strongest straight line, and those parallel to it.
#
# Each occupied cell votes, weighted by its certainty, for all lines through it. One wall of a hallway is
# the global maximum; the other is found by a search for a parallel line on either side of it (thesis section
# 5.5). Each line is then fitted to its cells, for a resolution better than a cell and a degree. Source: Duda
# and Hart 1972.


class WallLine(NamedTuple):
    """A straight line of a local map.

    Attributes:
        angle_deg: its direction, counterclockwise from ahead, in [-90, 90).
        distance_mm: its distance to the left of the origin, looking along its direction.
        weight: the sum of the certainties of its cells.
        begin_mm, end_mm: the extent of its cells along its direction, measured from the foot of the
            perpendicular from the origin.
        spread_mm: the standard deviation of its cells across it.
    """

    angle_deg: float
    distance_mm: float
    weight: float
    begin_mm: float
    end_mm: float
    spread_mm: float

    @property
    def length_mm(self) -> float:
        """Length of the line, from its first cell to its last one."""
        return self.end_mm - self.begin_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class HoughParameters:
    """The parameters of the search for lines.

    Attributes:
        angle_step_deg, distance_step_mm: the size of a bin.
        parallel_deg: the maximum angle between parallel lines.
        min_spacing_mm, max_spacing_mm: the range of the distance between the two walls of a hallway.
        inlier_mm: the maximum distance of a cell from the line to which it belongs.
        min_weight: minimum weight of a line.
        min_length_mm: minimum length of a line.
    """

    angle_step_deg: float = 1.0
    distance_step_mm: float = 100.0
    parallel_deg: float = 3.0
    min_spacing_mm: float = 1_200.0
    max_spacing_mm: float = 5_000.0
    inlier_mm: float = 150.0
    min_weight: float = 40.0
    min_length_mm: float = 800.0


def lines_in(cells: Cells, parameters: HoughParameters | None = None) -> tuple[WallLine, ...]:
    """Return the strongest line, and the strongest parallel on either side; none if the cells are too few."""
    parameters = parameters or HoughParameters()
    if cells.certainty.sum() < parameters.min_weight:
        return ()
    votes, angles, first_distance = _votes(cells, parameters)
    angle, distance = np.unravel_index(int(votes.argmax()), votes.shape)
    first = _fit_line(
        cells, angles[angle], first_distance + parameters.distance_step_mm * float(distance), parameters
    )
    if first is None:
        return ()
    lines = [first]
    for side in (1.0, -1.0):
        start = _find_parallel(votes, angles, first_distance, first, side, parameters)
        line = None if start is None else _fit_line(cells, *start, parameters)
        if line is not None:
            turn_deg = float(_wrap_half_turn(line.angle_deg - first.angle_deg))
            lines += [line] if abs(turn_deg) <= parameters.parallel_deg else []
    return tuple(lines)


def _votes(cells: Cells, parameters: HoughParameters) -> tuple[Floats, Floats, float]:
    """Return the votes, (angles, distances), the angles of the bins, and the distance of the first bin."""
    angles = np.radians(np.arange(-90.0, 90.0, parameters.angle_step_deg))
    distances = np.outer(np.cos(angles), cells.left_mm) - np.outer(np.sin(angles), cells.ahead_mm)
    step = parameters.distance_step_mm
    first_distance = math.floor(distances.min() / step) * step
    bins = np.rint((distances - first_distance) / step).astype(np.int64)
    width = int(bins.max()) + 2
    bins += np.arange(len(angles))[:, None] * width
    weights = np.broadcast_to(cells.certainty, bins.shape).ravel()
    counted = np.bincount(bins.ravel(), weights, len(angles) * width).reshape(-1, width)
    votes = np.array(counted, dtype=np.float64)
    votes[:, :-1] += counted[:, 1:] / 2.0  # the votes of a line between two bins are split between them
    return votes, angles, first_distance


def _find_parallel(
    votes: Floats,
    angles: Floats,
    first_distance: float,
    first: WallLine,
    side: float,
    parameters: HoughParameters,
) -> tuple[float, float] | None:
    """Return the strongest line that is parallel to the first one, at a plausible distance on one side."""
    turns_deg = np.degrees(angles) - first.angle_deg
    rows = np.flatnonzero(np.abs(_wrap_half_turn(turns_deg)) <= parameters.parallel_deg)
    # A line at 89 degrees and its parallel at -89 have opposite directions: left and right are swapped.
    sign = np.where(np.abs(turns_deg[rows]) > 90.0, -1.0, 1.0)[:, None]
    distances = first_distance + parameters.distance_step_mm * np.arange(votes.shape[1])
    spacing = side * (sign * distances - first.distance_mm)
    plausible = (spacing >= parameters.min_spacing_mm) & (spacing <= parameters.max_spacing_mm)
    if not plausible.any():
        return None
    candidates = np.where(plausible, votes[rows], -1.0)
    row, column = np.unravel_index(int(candidates.argmax()), candidates.shape)
    return float(angles[rows[row]]), float(distances[column])


def _wrap_half_turn(angle_deg: Floats | float) -> Floats:
    """Wrap the angle between two undirected lines to [-90, 90)."""
    return np.asarray((angle_deg + 90.0) % 180.0 - 90.0)


_REFINEMENTS = 3
_STRAY_FRACTION = 0.02
"""Fraction of a line's weight that is cut off at either end, as stray cells."""


def _fit_line(
    cells: Cells, angle_rad: float, distance_mm: float, parameters: HoughParameters
) -> WallLine | None:
    """Fit a line to the cells near it by total least squares; None if they are too few."""
    for _ in range(_REFINEMENTS):
        cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
        across = cosine * cells.left_mm - sine * cells.ahead_mm
        inliers = np.abs(across - distance_mm) <= parameters.inlier_mm
        weight = cells.certainty[inliers]
        total = float(weight.sum())
        if total < parameters.min_weight:
            return None
        along = (cosine * cells.ahead_mm + sine * cells.left_mm)[inliers]
        offset = across[inliers] - distance_mm
        mean_along, mean_offset = float(weight @ along) / total, float(weight @ offset) / total
        d_along, d_offset = along - mean_along, offset - mean_offset
        along_squared, along_offset, offset_squared = (
            float(weight @ (d_along * d_along)),
            float(weight @ (d_along * d_offset)),
            float(weight @ (d_offset * d_offset)),
        )
        turn = 0.5 * math.atan2(2.0 * along_offset, along_squared - offset_squared)
        # The line turns about the centroid of its cells.
        x = cosine * mean_along - sine * (distance_mm + mean_offset)
        y = sine * mean_along + cosine * (distance_mm + mean_offset)
        angle_rad += turn
        distance_mm = math.cos(angle_rad) * y - math.sin(angle_rad) * x
    order = np.argsort(along)
    cumulative = np.cumsum(weight[order]) / total
    first, last = np.searchsorted(cumulative, (_STRAY_FRACTION, 1.0 - _STRAY_FRACTION))
    ends = float(along[order[first]]), float(along[order[min(last, len(order) - 1)]])
    line = _normalize(angle_rad, distance_mm, total, ends, math.sqrt(max(offset_squared, 0.0) / total))
    return line if line.length_mm >= parameters.min_length_mm else None


def _normalize(
    angle_rad: float, distance_mm: float, weight: float, ends: tuple[float, float], spread: float
) -> WallLine:
    """Return the line with its angle wrapped to [-90, 90)."""
    angle = math.degrees(angle_rad)
    wrapped = (angle + 90.0) % 180.0 - 90.0
    sign = 1.0 if round((angle - wrapped) / 180.0) % 2 == 0 else -1.0
    begin, end = sorted(sign * end for end in ends)
    return WallLine(wrapped, sign * distance_mm, weight, begin, end, spread)


# --- local map ----------------------------------------------------------------------------------------


def pose_after(pose: LocalPose, step: OdometryStep) -> LocalPose:
    """Return the pose of a robot after a step."""
    sine, cosine = math.sin(pose.heading_rad), math.cos(pose.heading_rad)
    return LocalPose(
        ahead_mm=pose.ahead_mm + step.ahead_mm * cosine - step.left_mm * sine,
        left_mm=pose.left_mm + step.ahead_mm * sine + step.left_mm * cosine,
        heading_rad=pose.heading_rad + step.turned_rad,
    )


def relative_pose(origin: LocalPose, pose: LocalPose) -> LocalPose:
    """Return `pose` in the frame of `origin`, both poses in the same local map."""
    sine, cosine = math.sin(origin.heading_rad), math.cos(origin.heading_rad)
    ahead, left = pose.ahead_mm - origin.ahead_mm, pose.left_mm - origin.left_mm
    return LocalPose(
        ahead_mm=ahead * cosine + left * sine,
        left_mm=left * cosine - ahead * sine,
        heading_rad=pose.heading_rad - origin.heading_rad,
    )


_SPACING_MM, _SPACING_RAD = 60.0, math.radians(3.0)
"""Minimum distance or turn between two recorded scans."""


class ScanTrail:
    """The scans of the last few meters, located by odometry alone. Mutable.

    On demand, a map around the robot's current position is built from them.
    """

    def __init__(self, length_mm: float) -> None:
        """Keep the scans of the last `length_mm` traveled."""
        self._length_mm = length_mm
        self._scans: deque[tuple[float, LocalPose, Floats]] = deque()
        self._pose = LocalPose(0.0, 0.0, 0.0)
        self._travel_mm = 0.0

    @property
    def travel_mm(self) -> float:
        """Distance traveled since the oldest scan, in mm."""
        return self._travel_mm - self._scans[0][0] if self._scans else 0.0

    def clear(self) -> None:
        """Discard all scans."""
        self._scans.clear()

    def add(self, step: OdometryStep, ranges: Floats | None) -> None:
        """Record a step of the robot, and a scan after it, if there is one."""
        self._pose = pose_after(self._pose, step)
        self._travel_mm += math.hypot(step.ahead_mm, step.left_mm)
        if ranges is None:
            return
        if self._scans:
            travel_mm, last, _ = self._scans[-1]
            turned = abs(self._pose.heading_rad - last.heading_rad)
            if self._travel_mm - travel_mm < _SPACING_MM and turned < _SPACING_RAD:
                return
        self._scans.append((self._travel_mm, self._pose, ranges))
        while self._travel_mm - self._scans[0][0] > self._length_mm:
            self._scans.popleft()

    def lines(self, himm: HimmParameters, hough: HoughParameters | None = None) -> tuple[WallLine, ...]:
        """Return the lines in a map of these scans, with its origin at the robot's current position."""
        local_map = HimmMap(himm)
        for _, pose, ranges in self._scans:
            local_map.mark(relative_pose(self._pose, pose), ranges)
        return lines_in(local_map.cells(), hough)
