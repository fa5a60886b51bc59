"""Checks of walls and poses: shapes of arrays, finite numbers, and the clearance around every robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colony.nav.maps.stickrep.model import Pose
from colony.sim.compiled import Floats2, inlined

# --- wall boxes ----------------------------------------------------------------------------------------
#
# Boxes around groups of walls, by which compiled functions pass over walls that are far away.
#
# Walls keep their order, and each group is a run of neighbors in it, as maps and outlines have them. A
# function that looks for walls within a distance looks at the boxes first. A box is a little larger than
# its walls, so that rounding never hides a wall that is within the distance.


GROUP = 16
"""Number of walls in a group; the last group may have fewer."""

LOW_X, LOW_Y, HIGH_X, HIGH_Y, IS_OUTLINE = range(5)
"""Columns of the table of boxes: their sides in mm, and 1 for walls that are outlines of solid things."""

_MARGIN_MM = 1.0


def wall_boxes(walls: Floats2, *, outlines: bool = False) -> Floats2:
    """Return the boxes of walls.

    Args:
        walls: (n, 7), from `wall_table`.
        outlines: True if all walls are outlines of solid things, which are on their left: no light reaches
            their left sides.

    Returns:
        (groups, 5), see `LOW_X` to `IS_OUTLINE`.
    """
    starts = np.arange(0, len(walls), GROUP)
    boxes = np.empty((len(starts), 5))
    if len(walls):
        low, high = np.minimum(walls[:, :2], walls[:, 2:4]), np.maximum(walls[:, :2], walls[:, 2:4])
        boxes[:, LOW_X : LOW_Y + 1] = np.minimum.reduceat(low, starts) - _MARGIN_MM
        boxes[:, HIGH_X : HIGH_Y + 1] = np.maximum.reduceat(high, starts) + _MARGIN_MM
        boxes[:, IS_OUTLINE] = float(outlines)
    return boxes


@inlined
def box_gap(boxes: Floats2, group: int, x: float, y: float) -> float:
    """Return the square of the distance from a point to a box; no wall in it is nearer."""
    dx: float = max(boxes[group, LOW_X] - x, x - boxes[group, HIGH_X], 0.0)
    dy: float = max(boxes[group, LOW_Y] - y, y - boxes[group, HIGH_Y], 0.0)
    return dx * dx + dy * dy


# --- placing -------------------------------------------------------------------------------------------


MAX_ROBOTS = 10_000


def check_clearance(
    poses: NDArray[np.float64], walls: NDArray[np.float64], radii: NDArray[np.float64]
) -> None:
    """Raise ValueError if a robot overlaps a wall or another robot.

    Args:
        poses: (robots, 3), in mm and degrees.
        walls: (n, 7), from `wall_table`.
        radii: (robots,), the radii of their hulls.
    """
    for i, ((x, y, _), radius) in enumerate(zip(poses, radii, strict=True)):
        start, along = walls[:, :2] - (x, y), walls[:, 4:6]
        projections = np.clip(-(start * along).sum(axis=1), 0.0, walls[:, 6])
        distances = np.hypot(*(start + projections[:, None] * along).T)
        if (distances < radius).any():
            found = f"robot {i} at ({x:.0f}, {y:.0f}) is {distances.min():.0f} mm from a wall"
            raise ValueError(f"{found}; expected at least {radius:.0f} mm")
        gaps = np.hypot(*(poses[:i, :2] - (x, y)).T) - radii[:i]
        if (gaps < radius).any():
            raise ValueError(f"robot {i} at ({x:.0f}, {y:.0f}) overlaps robot {int(gaps.argmin())}")


def checked_walls(walls: ArrayLike) -> NDArray[np.float64]:
    """Return a copy of the walls, without walls of length 0."""
    checked = np.array(walls, dtype=np.float64, order="C")
    if checked.size == 0:
        return np.empty((0, 4))
    if checked.ndim != 2 or checked.shape[1] != 4:
        raise ValueError(f"walls have the shape {checked.shape}; expected (n, 4)")
    if not np.isfinite(checked).all():
        raise ValueError("a wall is not finite")
    return np.ascontiguousarray(checked[np.hypot(*(checked[:, 2:] - checked[:, :2]).T) > 0.0])


def checked_poses(poses: Sequence[tuple[float, float, float]]) -> NDArray[np.float64]:
    """Return a copy of the poses, with headings in [0, 360)."""
    checked = np.array(poses, dtype=np.float64)
    if checked.ndim != 2 or checked.shape[1] != 3 or len(checked) > MAX_ROBOTS:
        raise ValueError(
            f"the poses have the shape {checked.shape}; expected (n, 3), n from 1 to {MAX_ROBOTS}"
        )
    if not np.isfinite(checked).all():
        raise ValueError("a pose is not finite")
    checked[:, 2] %= 360.0
    return checked


def checked_docks(docks: Sequence[tuple[float, float, float]]) -> tuple[Pose, ...]:
    """Return the poses of docks, with headings in [0, 360)."""
    return tuple(Pose(*pose) for pose in checked_poses(docks).tolist()) if docks else ()


def checked_holes(holes: Sequence[ArrayLike]) -> tuple[NDArray[np.float64], ...]:
    """Return copies of the holes in a floor, polygons of at least three corners."""
    checked = tuple(np.array(hole, dtype=np.float64, order="C") for hole in holes)
    for hole in checked:
        if hole.ndim != 2 or hole.shape[1] != 2 or len(hole) < 3:
            raise ValueError(f"a hole has the shape {hole.shape}; expected (n, 2), n at least 3")
        if not np.isfinite(hole).all():
            raise ValueError("a hole is not finite")
    return checked
