"""A plate in an image: the place of the plate or, if that is known, of the robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from colony.nav.maps.signs import PLATE_HEIGHT_MM, Plate
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.fixes import Fix, Row
from colony.vision.level_camera import LevelCamera
from colony.vision.sightings import PlateBox, Reading

DEPTH_SIGMA = 0.04
"""The standard deviation of a distance by the height of a plate, as a part of it."""

BEARING_SIGMA_DEG = 0.15
"""The standard deviation of the direction of a plate: half a pixel, or so."""

MAP_SIGMA_MM = 15.0
"""The standard deviation of where a plate hangs, against the map."""

HEADING_SIGMA_DEG = 2.0
"""The standard deviation of the heading at which plates are looked at, or less than that."""

LOOKS = 6
"""Fixes of one plate share what is wrong with the plate: what is common to all is taken as that much less
sure in each."""


class Seen(NamedTuple):
    """A plate in an image.

    Attributes:
        t_ns: time of the image.
        robot: believed pose of the robot then.
        axis_deg: the heading of the optical axis, counterclockwise from north.
        bearing_deg: where the plate's middle is, counterclockwise from the optical axis.
        depth_mm: how far that is along the optical axis, by the plate's height in the image.
        rise_mm: height of its middle above the camera.
        score: how plate-like it is, from 0 to 1.
        reading: its reading.
    """

    t_ns: int
    robot: Pose
    axis_deg: float
    bearing_deg: float
    depth_mm: float
    rise_mm: float
    score: float
    reading: Reading

    @property
    def range_mm(self) -> float:
        """Distance of the plate."""
        return self.depth_mm / math.cos(math.radians(self.bearing_deg))

    @property
    def ray(self) -> tuple[float, float]:
        """The unit vector to the plate."""
        direction = math.radians(self.axis_deg + self.bearing_deg)
        return -math.sin(direction), math.cos(direction)

    @property
    def place(self) -> tuple[float, float]:
        """Place of the plate's middle, x and y in mm."""
        x, y = self.ray
        return self.robot.x_mm + self.range_mm * x, self.robot.y_mm + self.range_mm * y


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateSight:
    """A plate that the finder counts.

    Attributes:
        t_ns: the time of the image in which it was seen well enough.
        door: its door on the map, if the finder knows it.
        text, confidence: its text and the confidence; "" and 0 without a reader.
        place: place of its middle, x and y in mm, relative to the robot's believed pose.
        robot: believed pose of the robot in that image.
        looks: number of images in which it was seen by then.
    """

    t_ns: int
    door: str | None
    text: str
    confidence: float
    place: tuple[float, float]
    robot: Pose
    looks: int


def seen_of(
    box: PlateBox, camera: LevelCamera, robot: Pose, *, t_ns: int, reading: Reading, first_row: int = 0
) -> Seen:
    """Return the place in the plane of a plate in an image; `first_row` is that of the band it was found in.

    The middle of a plate is where the diagonals of its image cross, however it is tilted.
    """
    (left, left_top), (right, right_top), (_, right_bottom), (_, left_bottom) = box.corners
    near, far = left_bottom - left_top, right_bottom - right_top
    part = near / (near + far)
    height = near + part * (far - near)
    row = (left_top + left_bottom) * (1.0 - part) / 2.0 + (right_top + right_bottom) * part / 2.0 + first_row
    depth = camera.focal * PLATE_HEIGHT_MM / height
    return Seen(
        t_ns=t_ns,
        robot=robot,
        axis_deg=robot.heading_deg + camera.yaw_deg,
        bearing_deg=camera.bearing_of(left + part * (right - left)),
        depth_mm=depth,
        rise_mm=((camera.rows - 1) / 2.0 - row) * depth / camera.focal,
        score=box.score,
        reading=reading,
    )


def fix_of_plate(seen: Seen, plate: Plate) -> Fix:
    """Return the fix of the robot's pose by a look at a known plate.

    The place across the line of sight is accurate, the distance less so.
    """
    bearing = _bearing_row(seen, plate)
    return Fix(seen.t_ns, (bearing, _depth_row(seen, plate)))


def _bearing_row(seen: Seen, plate: Plate) -> Row:
    """Return the row of the line of sight: n (plate - robot) = 0, n across it; the heading turns it."""
    x, y = seen.ray
    nx, ny = y, -x
    away = x * (plate.middle.x - seen.robot.x_mm) + y * (plate.middle.y - seen.robot.y_mm)
    value = nx * plate.middle.x + ny * plate.middle.y - away * math.radians(seen.robot.heading_deg)
    own = away * math.radians(BEARING_SIGMA_DEG)
    return Row(nx, ny, -away, value, math.hypot(own, math.sqrt(LOOKS) * MAP_SIGMA_MM))


def _depth_row(seen: Seen, plate: Plate) -> Row:
    """Return the row of the plate's depth: a (plate - robot) = depth, a along the optical axis.

    The heading changes it by little, by nothing if the plate is straight before the camera: too little to
    resolve a turn of the heading. So the heading is a part of the uncertainty.
    """
    axis = math.radians(seen.axis_deg)
    ax, ay = -math.sin(axis), math.cos(axis)
    dx, dy = plate.middle.x - seen.robot.x_mm, plate.middle.y - seen.robot.y_mm
    turning = (ay * dx - ax * dy) * math.radians(HEADING_SIGMA_DEG)
    value = ax * plate.middle.x + ay * plate.middle.y - seen.depth_mm
    own = math.sqrt(LOOKS) * math.hypot(DEPTH_SIGMA * seen.depth_mm, MAP_SIGMA_MM)
    return Row(ax, ay, 0.0, value, math.hypot(own, turning))
