"""Checks of walls and poses: shapes of arrays, finite numbers, and the clearance around every robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from colony.nav.maps.stickrep.model import Pose

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
