"""A step of a world: people walk, robots move, and wheels slip, in substeps.

It is one compiled function, since each call of one from Python takes microseconds for its arguments.
"""

from __future__ import annotations

from colony.sim.compiled import Floats2, compiled
from colony.sim.world.base import Bases, move
from colony.sim.world.floor import Floor, slip
from colony.sim.world.people import Crowd, walk


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
