"""Metal expansion joints in the floor, on which wheels slip.

When the center of a robot crosses a joint, its wheels may slip. They spin for a few centimeters, which the
odometry counts although the robot does not move, and the robot turns, unnoticed by the odometry. Each
crossing has its own random numbers: the third crossing of a run is the same whenever it happens.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from colony.sim.chance import SLIPS, deviate, uniform
from colony.sim.compiled import Floats2, Floats4, Ints, called, inlined
from colony.sim.hazards.scenery import Joint, Slip


class Floor(NamedTuple):
    """The joints as arrays, as the compiled functions take them.

    Attributes:
        joints: (n, 4), x0, y0, x1, y1 in mm.
        crossings: (robots,), number of joints crossed by each robot so far, on all floors.
        probability, turn_deg, min_mm, max_mm: as in `Slip`.
        seed: seed of the slips.
    """

    joints: Floats2
    crossings: Ints
    probability: float
    turn_deg: float
    min_mm: float
    max_mm: float
    seed: int


def floor_of(joints: Sequence[Joint], slip: Slip, *, crossings: Ints, seed: int) -> Floor:
    """Return a floor that continues the counts `crossings`, (robots,)."""
    ends = [(j.x0_mm, j.y0_mm, j.x1_mm, j.y1_mm) for j in joints]
    return Floor(
        joints=np.array(ends, dtype=np.float64).reshape(-1, 4),
        crossings=crossings,
        probability=float(slip.probability),
        turn_deg=float(slip.turn_deg),
        min_mm=float(slip.min_mm),
        max_mm=float(slip.max_mm),
        seed=seed,
    )


@inlined
def _crosses(floor: Floor, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Return True if the segment from (x0, y0) to (x1, y1) crosses a joint."""
    crossed = False
    for joint in range(floor.joints.shape[0]):
        jx, jy = floor.joints[joint, 0], floor.joints[joint, 1]
        ex, ey = floor.joints[joint, 2] - jx, floor.joints[joint, 3] - jy
        before, after = ex * (y0 - jy) - ey * (x0 - jx), ex * (y1 - jy) - ey * (x1 - jx)
        if (before < 0.0) != (after < 0.0):
            fraction = before / (before - after)
            along = (x0 + fraction * (x1 - x0) - jx) * ex + (y0 + fraction * (y1 - y0) - jy) * ey
            crossed |= (along >= 0.0) & (along <= ex * ex + ey * ey)
    return crossed


@inlined
def _slip(
    robot: int, floor: Floor, poses: Floats2, odometry: Floats2, wheels: Floats4, travel: Floats2,
    ahead: float, left: float,
) -> None:  # fmt: skip
    """Draw and apply the slip of a robot on a joint; it drives along the unit vector (`ahead`, `left`)."""
    event = floor.crossings[robot] + 1_000_000 * robot
    floor.crossings[robot] += 1
    if uniform(floor.seed, SLIPS, event, 0) < floor.probability:
        turn = floor.turn_deg * deviate(floor.seed, SLIPS, event, 1)
        poses[robot, 2] = (poses[robot, 2] + turn) % 360.0
        spin_mm = floor.min_mm + (floor.max_mm - floor.min_mm) * uniform(floor.seed, SLIPS, event, 3)
        for wheel in range(travel.shape[1]):
            rolling = wheels[robot, wheel, 0]
            travel[robot, wheel] += (ahead * rolling[0] + left * rolling[1]) * spin_mm
        heading = math.radians(odometry[robot, 2])
        odometry[robot, 0] -= ahead * spin_mm * math.sin(heading) + left * spin_mm * math.cos(heading)
        odometry[robot, 1] += ahead * spin_mm * math.cos(heading) - left * spin_mm * math.sin(heading)


@called
def slip(
    floor: Floor, before: Floats2, poses: Floats2, speeds: Floats2, odometry: Floats2, wheels: Floats4,
    travel: Floats2,
) -> None:  # fmt: skip
    """Apply wheel slip to robots that moved from `before` to `poses`, both (robots, 3), in a substep.

    Args:
        floor: the floor; changed.
        before: the poses before.
        poses: the poses now; changed.
        speeds: (robots, 3), ahead, turning, and sideways.
        odometry: the poses according to odometry; changed.
        wheels: (robots, wheels, 2, 3), as in `Bases`.
        travel: (robots, wheels), how far the wheels have rolled by their own reports; changed.
    """
    for robot in range(poses.shape[0]):
        if _crosses(floor, before[robot, 0], before[robot, 1], poses[robot, 0], poses[robot, 1]):
            ahead, left = 1.0 if speeds[robot, 0] >= 0.0 else -1.0, 0.0
            if speeds[robot, 2] != 0.0:
                speed = math.hypot(speeds[robot, 0], speeds[robot, 2])
                ahead, left = speeds[robot, 0] / speed, speeds[robot, 2] / speed
            _slip(robot, floor, poses, odometry, wheels, travel, ahead, left)
