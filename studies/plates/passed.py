"""The door plates that a robot actually passed on its left, and the time for which each was in view.

This is the ground truth for plate finders: it comes from the map and the true path. A plate is *passed* when
the robot crosses the normal of the wall through the plate's center, with the plate to its left, no farther
than `MAX_DISTANCE_MM` and no wall in between. It is *in view* while both of its ends are in the camera's
field of view, it is no farther than `MAX_DISTANCE_MM`, and the camera is turned away from the normal by less
than `MAX_ANGLE_DEG`, beyond which finders do not look (thesis section 5.7). People in front of the plate are
ignored: they count against the finder.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.signs import PLATE_WIDTH_MM, Plate
from colony.nav.maps.stickrep.geometry import direction
from colony.nav.maps.stickrep.model import Pose
from colony.vision.level_camera import SIDE

MAX_DISTANCE_MM = 2500.0
"""Maximum distance of a plate's center from the camera."""

MAX_ANGLE_DEG = 50.0
"""Maximum angle between the camera's axis and the normal of the wall."""

_BEFORE_WALL_MM = 20.0


class Pass(NamedTuple):
    """A plate, by its number, with the time at which it was passed and the total time in view."""

    plate: int
    at_ns: int
    in_view_ns: int


class PassMonitor:
    """The monitor of passed plates, updated with the true pose of each frame. Mutable.

    Args:
        plates: all plates of the floor.
        walls: the walls that hide plates, (n, 4) in mm.
    """

    def __init__(self, plates: Sequence[Plate], walls: NDArray[np.float64]) -> None:
        self._walls = walls
        self._half_view = math.radians(SIDE.view_deg / 2.0)
        self._headings = np.array([plate.heading_deg for plate in plates])
        self._centers = np.array([plate.center for plate in plates], dtype=np.float64).reshape(-1, 2)
        inward = [direction(plate.heading_deg) for plate in plates]
        self._inward = np.array(inward, dtype=np.float64).reshape(-1, 2)
        self._in_view_ns = np.zeros(len(plates), dtype=np.int64)
        self._along: NDArray[np.float64] | None = None
        self._passed: dict[int, int] = {}
        self._last_ns = 0

    def update(self, t_ns: int, pose: Pose) -> None:
        """Record the robot's pose; times must increase from call to call."""
        to_plate = self._centers - (pose.x_mm, pose.y_mm)
        depth = (to_plate * self._inward).sum(axis=1)
        # A robot with the wall on its left moves along (inward.y, -inward.x).
        along = to_plate[:, 0] * self._inward[:, 1] - to_plate[:, 1] * self._inward[:, 0]
        turned = np.remainder(pose.heading_deg + SIDE.yaw_deg - self._headings + 180.0, 360.0) - 180.0
        near = (depth > 0.0) & (np.hypot(depth, along) <= MAX_DISTANCE_MM)
        self._update_views(t_ns, pose, near & (np.abs(turned) < MAX_ANGLE_DEG))
        if self._along is not None:
            crossed = near & (np.abs(turned) < 90.0) & (self._along > 0.0) & (along <= 0.0)
            for plate in np.flatnonzero(crossed).tolist():
                if self._is_in_sight(pose, plate):
                    self._passed.setdefault(plate, t_ns)
        self._along, self._last_ns = along, t_ns

    @property
    def passes(self) -> tuple[Pass, ...]:
        """The passed plates in chronological order."""
        return tuple(
            Pass(plate, at_ns, int(self._in_view_ns[plate]))
            for plate, at_ns in sorted(self._passed.items(), key=lambda item: (item[1], item[0]))
        )

    def _update_views(self, t_ns: int, pose: Pose, candidates: NDArray[np.bool_]) -> None:
        axis = direction(pose.heading_deg + SIDE.yaw_deg)
        for plate in np.flatnonzero(candidates).tolist():
            center, inward = self._centers[plate], self._inward[plate]
            half = PLATE_WIDTH_MM / 2.0 * np.array([inward[1], -inward[0]])
            ends = (center - half - pose[:2], center + half - pose[:2])
            in_field = all(
                abs(math.atan2(axis.x * y - axis.y * x, axis.x * x + axis.y * y)) <= self._half_view
                for x, y in ends
            )
            if in_field and self._is_in_sight(pose, plate):
                self._in_view_ns[plate] += t_ns - self._last_ns

    def _is_in_sight(self, pose: Pose, plate: int) -> bool:
        """Return True if no wall is between the robot and a plate's center."""
        eye = np.array(pose[:2])
        ray = self._centers[plate] - _BEFORE_WALL_MM * self._inward[plate] - eye
        start = self._walls[:, :2] - eye
        end = self._walls[:, 2:] - eye
        side_start = ray[0] * start[:, 1] - ray[1] * start[:, 0]
        side_end = ray[0] * end[:, 1] - ray[1] * end[:, 0]
        wall = end - start
        side_eye = wall[:, 1] * start[:, 0] - wall[:, 0] * start[:, 1]
        side_plate = side_eye + wall[:, 0] * ray[1] - wall[:, 1] * ray[0]
        return not bool(((side_start * side_end < 0.0) & (side_eye * side_plate < 0.0)).any())
