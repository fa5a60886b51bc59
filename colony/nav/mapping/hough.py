"""The Hough transform of a local map: its strongest straight line, and those parallel to it.

Each occupied cell votes, weighted by its certainty, for all lines through it. The walls of a hallway are the
global maximum, and what a search guided by it finds on the other side (thesis section 5.5). Each line is then
fitted to its cells, for a resolution better than a cell and a degree. Source: Duda and Hart 1972.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from colony.nav.mapping.himm import Cells
from colony.nav.pose.echoes import Floats


class Line(NamedTuple):
    """A straight line of a local map.

    Attributes:
        angle_deg: its direction, counterclockwise from ahead, in [-90, 90).
        distance_mm: its distance to the left of the origin, looking along its direction.
        weight: the sum of the certainties of its cells.
        begin_mm, end_mm: the range of its cells along its direction, from the foot of the perpendicular
            through the origin.
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
        parallel_deg: the largest angle between parallel lines.
        least_apart_mm, most_apart_mm: the distance between the two walls of a hallway.
        near_mm: the largest distance of a cell from the line to which it belongs.
        least_weight: the least weight of a line.
        least_length_mm: the least length of a line.
    """

    angle_step_deg: float = 1.0
    distance_step_mm: float = 100.0
    parallel_deg: float = 3.0
    least_apart_mm: float = 1_200.0
    most_apart_mm: float = 5_000.0
    near_mm: float = 150.0
    least_weight: float = 40.0
    least_length_mm: float = 800.0


def lines_in(cells: Cells, parameters: HoughParameters | None = None) -> tuple[Line, ...]:
    """Return the strongest line, and the strongest parallel on either side; none if the cells are too few."""
    parameters = parameters or HoughParameters()
    if cells.certainty.sum() < parameters.least_weight:
        return ()
    votes, angles, nearest = _votes(cells, parameters)
    angle, distance = np.unravel_index(int(votes.argmax()), votes.shape)
    first = _fitted(cells, angles[angle], nearest + parameters.distance_step_mm * float(distance), parameters)
    if first is None:
        return ()
    found = [first]
    for side in (1.0, -1.0):
        start = _guided(votes, angles, nearest, first, side, parameters)
        line = None if start is None else _fitted(cells, *start, parameters)
        if line is not None:
            off = float(_half_turned(line.angle_deg - first.angle_deg))
            found += [line] if abs(off) <= parameters.parallel_deg else []
    return tuple(found)


def _votes(cells: Cells, parameters: HoughParameters) -> tuple[Floats, Floats, float]:
    """Return the votes, (angles, distances), the bins' angles, and the first bin's distance."""
    angles = np.radians(np.arange(-90.0, 90.0, parameters.angle_step_deg))
    distances = np.outer(np.cos(angles), cells.left_mm) - np.outer(np.sin(angles), cells.ahead_mm)
    step = parameters.distance_step_mm
    nearest = math.floor(distances.min() / step) * step
    bins = np.rint((distances - nearest) / step).astype(np.int64)
    width = int(bins.max()) + 2
    bins += np.arange(len(angles))[:, None] * width
    weights = np.broadcast_to(cells.certainty, bins.shape).ravel()
    counted = np.bincount(bins.ravel(), weights, len(angles) * width).reshape(-1, width)
    votes = np.array(counted, dtype=np.float64)
    votes[:, :-1] += counted[:, 1:] / 2.0  # a line between two bins has votes in both
    return votes, angles, nearest


def _guided(
    votes: Floats, angles: Floats, nearest: float, first: Line, side: float, parameters: HoughParameters
) -> tuple[float, float] | None:
    """Return the strongest line parallel to the first one, at a plausible distance on one side of it."""
    off = np.degrees(angles) - first.angle_deg
    rows = np.flatnonzero(np.abs(_half_turned(off)) <= parameters.parallel_deg)
    # A line at 89 degrees and its parallel at -89 have opposite directions: left and right are swapped.
    sign = np.where(np.abs(off[rows]) > 90.0, -1.0, 1.0)[:, None]
    distances = nearest + parameters.distance_step_mm * np.arange(votes.shape[1])
    apart = side * (sign * distances - first.distance_mm)
    plausible = (apart >= parameters.least_apart_mm) & (apart <= parameters.most_apart_mm)
    if not plausible.any():
        return None
    part = np.where(plausible, votes[rows], -1.0)
    row, column = np.unravel_index(int(part.argmax()), part.shape)
    return float(angles[rows[row]]), float(distances[column])


def _half_turned(angle_deg: Floats | float) -> Floats:
    """Return the angle between directionless lines, in [-90, 90)."""
    return np.asarray((angle_deg + 90.0) % 180.0 - 90.0)


_REFINEMENTS = 3
_STRAY = 0.02
"""Part of a line's weight that is cut off at either end: stray cells on the line."""


def _fitted(cells: Cells, angle_rad: float, distance_mm: float, parameters: HoughParameters) -> Line | None:
    """Fit a line to the cells near to it by total least squares; None if they are too few."""
    for _ in range(_REFINEMENTS):
        cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
        across = cosine * cells.left_mm - sine * cells.ahead_mm
        near = np.abs(across - distance_mm) <= parameters.near_mm
        weight = cells.certainty[near]
        total = float(weight.sum())
        if total < parameters.least_weight:
            return None
        along = (cosine * cells.ahead_mm + sine * cells.left_mm)[near]
        off = across[near] - distance_mm
        middle_along, middle_off = float(weight @ along) / total, float(weight @ off) / total
        da, do = along - middle_along, off - middle_off
        aa, ao, oo = float(weight @ (da * da)), float(weight @ (da * do)), float(weight @ (do * do))
        turn = 0.5 * math.atan2(2.0 * ao, aa - oo)
        # The line turns about the middle of its cells, which is `middle_along` ahead.
        x = cosine * middle_along - sine * (distance_mm + middle_off)
        y = sine * middle_along + cosine * (distance_mm + middle_off)
        angle_rad += turn
        distance_mm = math.cos(angle_rad) * y - math.sin(angle_rad) * x
    order = np.argsort(along)
    part = np.cumsum(weight[order]) / total
    first, last = np.searchsorted(part, (_STRAY, 1.0 - _STRAY))
    ends = float(along[order[first]]), float(along[order[min(last, len(order) - 1)]])
    line = _in_order(angle_rad, distance_mm, total, ends, math.sqrt(max(oo, 0.0) / total))
    return line if line.length_mm >= parameters.least_length_mm else None


def _in_order(
    angle_rad: float, distance_mm: float, weight: float, ends: tuple[float, float], spread: float
) -> Line:
    """Return a line with its angle in [-90, 90)."""
    angle = math.degrees(angle_rad)
    wrapped = (angle + 90.0) % 180.0 - 90.0
    sign = 1.0 if round((angle - wrapped) / 180.0) % 2 == 0 else -1.0
    begin, end = sorted(sign * end for end in ends)
    return Line(wrapped, sign * distance_mm, weight, begin, end, spread)
