"""Where robots are touched."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from colony.sim.world.base import SKIN_MM


def contact_bearings(
    poses: NDArray[np.float64],
    people: NDArray[np.float64],
    walls: NDArray[np.float64],
    robot: int,
    *,
    radii_mm: NDArray[np.float64],
    person_radius_mm: float,
) -> NDArray[np.float64]:
    """Return the bearings at which walls, other robots and people touch the hull of a robot.

    Each of them touches it in one place, the nearest one.

    Args:
        poses: (robots, 3), x and y in mm, heading in degrees.
        people: (people, 2), x and y in mm.
        walls: (n, 7), the solid walls, from `wall_table`.
        robot: the number of the robot.
        radii_mm: (robots,), the radii of the robots.
        person_radius_mm: the radius of a person.

    Returns:
        (contacts,), in degrees counterclockwise from ahead, in [0, 360).
    """
    here, heading = poses[robot, :2], poses[robot, 2]
    starts, along = walls[:, :2] - here, walls[:, 4:6]
    nearest = np.clip(-(starts * along).sum(axis=1), 0.0, walls[:, 6])
    others = np.delete(poses[:, :2], robot, axis=0) - here
    ways = np.vstack([starts + nearest[:, None] * along, others, people - here])
    thickness = np.concatenate(
        [np.zeros(len(walls)), np.delete(radii_mm, robot), np.full(len(people), person_radius_mm)]
    )
    reaches = radii_mm[robot] + SKIN_MM + thickness
    dx, dy = ways[np.hypot(ways[:, 0], ways[:, 1]) < reaches].T
    bearings: NDArray[np.float64] = (np.degrees(np.arctan2(-dx, dy)) - heading) % 360.0
    return bearings
