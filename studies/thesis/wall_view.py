"""The geometry of a camera that faces a wall (thesis section 5.7, Figures 5.17 and 5.18).

Beta is the angle between the optical axis and the wall's normal, positive where the robot is turned
counterclockwise against the hallway; d is the distance of the wall from the camera, perpendicular to it.
Positions along the wall are in mm to the left, as seen facing the wall, of the foot of the normal through the
camera. So for a camera that looks to the left they increase backward, against the robot's motion.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from colony.vision.level_camera import LevelCamera


class WallView(NamedTuple):
    """A wall as a camera sees it: `distance_mm` is d, above 0, `tilt_deg` beta, within 90 degrees."""

    distance_mm: float
    tilt_deg: float

    def left_mm(self, view_deg: float) -> float:
        """Return l: the distance along the wall from the foot of the normal to the left ray.

        It is negative to the right of the foot, and infinite without an intersection.
        """
        return self._reach_mm(self.tilt_deg + view_deg / 2.0)

    def right_mm(self, view_deg: float) -> float:
        """Return r: the distance along the wall from the foot of the normal to the right ray.

        Alpha is the angle between the normal and the right ray.
        """
        alpha = view_deg / 2.0 - self.tilt_deg
        return self._reach_mm(alpha)

    def place_of(self, camera: LevelCamera, column: float) -> float:
        """Return the position along the wall that a column sees; the column's ray must hit the wall."""
        return self.distance_mm * math.tan(math.radians(self.tilt_deg + camera.bearing_of(column)))

    def column_of(self, camera: LevelCamera, place_mm: float) -> float:
        """Return the column of a position, in the image or beside it; the position is ahead of the camera."""
        return camera.column_of(math.degrees(math.atan(place_mm / self.distance_mm)) - self.tilt_deg)

    def _reach_mm(self, angle_deg: float) -> float:
        return self.distance_mm * math.tan(math.radians(angle_deg)) if angle_deg < 90.0 else math.inf


def overlap_mm(first: WallView, second: WallView, moved_mm: float, view_deg: float) -> float:
    """Return r1 + l2 - D: the length of the wall that two images share; 0 or less if they share nothing.

    The second image is taken `moved_mm` (D) further on. The formula is printed for a robot that drives
    forward with the wall on its left: the wall at the right of the first image enters the second one from the
    left.
    """
    return first.right_mm(view_deg) + second.left_mm(view_deg) - moved_mm


def starting_column(first: WallView, second: WallView, moved_mm: float, camera: LevelCamera) -> int:
    """Return the first column of the second image that shows wall not in the first image.

    It is at least 0 and at most the number of columns.
    """
    shared = overlap_mm(first, second, moved_mm, camera.view_deg)
    if shared <= 0.0:
        return 0
    border = second.left_mm(camera.view_deg) - shared
    if border <= -second.right_mm(camera.view_deg):
        return camera.columns
    return min(max(math.ceil(second.column_of(camera, border)), 0), camera.columns)
