"""The plane around an emulated robot: mm, x ahead at the start, y to the left; degrees counterclockwise."""

from __future__ import annotations

import math
from collections.abc import Callable

Pose = tuple[float, float, float]
"""A pose: x, y and heading."""

Surroundings = Callable[[float, float, float], float]
"""A function that returns the range in mm from x, y into a direction in degrees; infinite for nothing."""


def open_field(x: float, y: float, bearing: float) -> float:
    """Return infinity: there is nothing."""
    return math.inf


def room(width: float, depth: float) -> Surroundings:
    """Return an empty room around the start, `depth` mm from front to back, `width` from side to side."""

    def range_from(x: float, y: float, bearing: float) -> float:
        ahead, left = math.cos(math.radians(bearing)), math.sin(math.radians(bearing))
        walls = (
            (depth / 2.0 - math.copysign(x, x * ahead), ahead),
            (width / 2.0 - math.copysign(y, y * left), left),
        )
        return max(0.0, min((gap / abs(part) for gap, part in walls if abs(part) > 1e-9), default=math.inf))

    return range_from


def moved(pose: Pose, speed: float, turn: float, time_s: float) -> Pose:
    """Return the pose after `time_s` seconds at `speed` mm/s ahead and `turn` deg/s."""
    x, y, heading = pose
    middle = math.radians(heading + turn * time_s / 2.0)
    return (
        x + speed * time_s * math.cos(middle),
        y + speed * time_s * math.sin(middle),
        heading + turn * time_s,
    )
