"""A step of a world: people walk, robots move, and wheels slip, in substeps.

It is one compiled function, since each call of one from Python takes microseconds for its arguments.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.sim.chance import SLIPS, deviate, uniform
from colony.sim.compiled import Floats2, Floats4, Ints, called, compiled, inlined
from colony.sim.hazards.scenery import ExpansionJoint, WheelSlip
from colony.sim.world.base import SKIN_MM, Bases, move
from colony.sim.world.people import Crowd, walk

# --- floor --------------------------------------------------------------------------------------------
#
# Metal expansion joints in the floor, on which wheels slip.
#
# When the center of a robot crosses a joint, its wheels may slip. They spin for a few centimeters, which the
# odometry counts although the robot does not move, and the robot turns, unnoticed by the odometry. Each
# crossing has its own random numbers: the third crossing of a run is the same whenever it happens.


class Floor(NamedTuple):
    """The joints as arrays, as the compiled functions take them.

    Attributes:
        joints: (n, 4), x0, y0, x1, y1 in mm.
        crossings: (robots,), number of joints crossed by each robot so far, on all floors.
        probability, turn_deg, min_mm, max_mm: as in `WheelSlip`.
        seed: seed of the slips.
    """

    joints: Floats2
    crossings: Ints
    probability: float
    turn_deg: float
    min_mm: float
    max_mm: float
    seed: int


def floor_of(joints: Sequence[ExpansionJoint], slip: WheelSlip, *, crossings: Ints, seed: int) -> Floor:
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


# --- contacts -----------------------------------------------------------------------------------------
#
# Where robots are touched.


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


# --- stepping -----------------------------------------------------------------------------------------


@compiled
def step(
    bases: Bases, drivetrains: Floats2, walls: Floats2, boxes: Floats2, crowd: Crowd, floor: Floor,
    noise: Floats2, noise_column: int, noise_columns: int, substeps: int, slices: int, has_events: bool,
    time_s: float,
) -> None:  # fmt: skip
    """Take a step of `time_s` seconds.

    Args:
        bases: the bases; changed.
        drivetrains: (robots, fields), the parameters of their drivetrains, as in `Drivetrain`.
        walls: the walls, from `wall_table`.
        boxes: their boxes, from `wall_boxes`.
        crowd: the people; changed.
        floor: the floor; changed.
        noise: (robots, k), standard normal numbers, one per slice and wheel.
        noise_column: the first column of `noise` for the wheels.
        noise_columns: the number of columns of `noise` that a substep takes.
        substeps: the number of substeps of equal length: in each, people walk before robots move.
        slices: the number of slices of a substep.
        has_events: whether there are people, or joints in the floor.
        time_s: the time in seconds.
    """
    substep_s = time_s / substeps
    for substep in range(substeps):
        column = noise_column + noise_columns * substep
        if has_events:
            before = bases.poses.copy()
            walk(crowd, bases.poses, bases.radii, substep_s)
            move(bases, drivetrains, walls, boxes, crowd, noise, column, slices, substep_s)
            slip(floor, before, bases.poses, bases.speeds, bases.odometry, bases.wheels, bases.travel)
        else:
            move(bases, drivetrains, walls, boxes, crowd, noise, column, slices, substep_s)
