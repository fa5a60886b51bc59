"""Observations of plates in images: the position of the plate or, if it is known, of the robot."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from colony.nav.maps.signs import PLATE_HEIGHT_MM, Plate
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.pose import Fix, MeasurementRow
from colony.vision.detections import PlateBox, PlateReading
from colony.vision.level_camera import LevelCamera

DEPTH_SIGMA = 0.04
"""Standard deviation of a distance by the height of a plate, as a fraction of the distance."""

BEARING_SIGMA_DEG = 0.15
"""Standard deviation of the direction of a plate: about half a pixel."""

MAP_SIGMA_MM = 15.0
"""Standard deviation of a plate's position on the map."""

HEADING_SIGMA_DEG = 2.0
"""Upper bound of the standard deviation of the heading while plates are observed."""

CORRELATED_FIXES = 6
"""Number of fixes of one plate that share its errors: the variance of shared errors is multiplied by it."""


class PlateObservation(NamedTuple):
    """An observation of a plate in an image.

    Attributes:
        t_ns: time of the image.
        robot: estimated pose of the robot at that time.
        axis_deg: heading of the optical axis, counterclockwise from north.
        bearing_deg: bearing of the plate's center, counterclockwise from the optical axis.
        depth_mm: distance of the center along the optical axis, by the plate's height in the image.
        rise_mm: height of the center above the camera.
        score: score of the detection, from 0 to 1.
        reading: its reading.
    """

    t_ns: int
    robot: Pose
    axis_deg: float
    bearing_deg: float
    depth_mm: float
    rise_mm: float
    score: float
    reading: PlateReading

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
        """Position of the plate's center, x and y in mm."""
        x, y = self.ray
        return self.robot.x_mm + self.range_mm * x, self.robot.y_mm + self.range_mm * y


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundPlate:
    """A plate that the finder reports.

    Attributes:
        t_ns: time of the image that confirmed it.
        door: its door on the map; None if unknown.
        text, confidence: its text and the confidence; "" and 0 without a reader.
        place: position of its center, x and y in mm, by the robot's estimated pose.
        robot: estimated pose of the robot at the time of that image.
        images: number of images in which it had been observed by then.
    """

    t_ns: int
    door: str | None
    text: str
    confidence: float
    place: tuple[float, float]
    robot: Pose
    images: int


def observe_plate(
    box: PlateBox, camera: LevelCamera, robot: Pose, *, t_ns: int, reading: PlateReading, first_row: int = 0
) -> PlateObservation:
    """Return the observation of a plate in an image, or in a band that begins with row `first_row`.

    The center of a plate is where the diagonals of its image cross, at any tilt.
    """
    (left, left_top), (right, right_top), (_, right_bottom), (_, left_bottom) = box.corners
    left_height, right_height = left_bottom - left_top, right_bottom - right_top
    fraction = left_height / (left_height + right_height)
    height = left_height + fraction * (right_height - left_height)
    row = (
        (left_top + left_bottom) * (1.0 - fraction) / 2.0
        + (right_top + right_bottom) * fraction / 2.0
        + first_row
    )
    depth = camera.focal * PLATE_HEIGHT_MM / height
    return PlateObservation(
        t_ns=t_ns,
        robot=robot,
        axis_deg=robot.heading_deg + camera.yaw_deg,
        bearing_deg=camera.bearing_of(left + fraction * (right - left)),
        depth_mm=depth,
        rise_mm=((camera.rows - 1) / 2.0 - row) * depth / camera.focal,
        score=box.score,
        reading=reading,
    )


def fix_of_plate(observation: PlateObservation, plate: Plate) -> Fix:
    """Return the fix of the robot's pose by an observation of a known plate.

    The measurement across the line of sight is accurate, that along it less so.
    """
    bearing = _bearing_row(observation, plate)
    return Fix(observation.t_ns, (bearing, _depth_row(observation, plate)))


def _bearing_row(observation: PlateObservation, plate: Plate) -> MeasurementRow:
    """Return the row of the line of sight: n (plate - robot) = 0, n across it; the heading rotates it."""
    x, y = observation.ray
    nx, ny = y, -x
    distance = x * (plate.center.x - observation.robot.x_mm) + y * (plate.center.y - observation.robot.y_mm)
    value = nx * plate.center.x + ny * plate.center.y - distance * math.radians(observation.robot.heading_deg)
    own_sigma_mm = distance * math.radians(BEARING_SIGMA_DEG)
    return MeasurementRow(
        nx, ny, -distance, value, math.hypot(own_sigma_mm, math.sqrt(CORRELATED_FIXES) * MAP_SIGMA_MM)
    )


def _depth_row(observation: PlateObservation, plate: Plate) -> MeasurementRow:
    """Return the row of the plate's depth: a (plate - robot) = depth, a along the optical axis.

    The depth depends little on the heading, and not at all for a plate on the optical axis. This is too
    little to resolve full turns, so the row has no coefficient for the heading; the heading's uncertainty is
    added to sigma.
    """
    axis = math.radians(observation.axis_deg)
    ax, ay = -math.sin(axis), math.cos(axis)
    dx, dy = plate.center.x - observation.robot.x_mm, plate.center.y - observation.robot.y_mm
    heading_sigma_mm = (ay * dx - ax * dy) * math.radians(HEADING_SIGMA_DEG)
    value = ax * plate.center.x + ay * plate.center.y - observation.depth_mm
    own_sigma_mm = math.sqrt(CORRELATED_FIXES) * math.hypot(DEPTH_SIGMA * observation.depth_mm, MAP_SIGMA_MM)
    return MeasurementRow(ax, ay, 0.0, value, math.hypot(own_sigma_mm, heading_sigma_mm))


# --- map ----------------------------------------------------------------------------------------------
#
# Data association: the map's plate for an observed plate, by its position and its text.

MIN_GATE_MM, MAX_GATE_MM = 260.0, 1_200.0
"""Gates for a plate's distance from its position in the map, along the wall.

The first is for an accurate estimate of the robot's position, the second for an uncertain one.
"""

GATE_SIGMAS = 3.0

MAX_FACING_DEG = 60.0
"""Maximum angle between the camera's axis and the normal of an observed plate's wall."""

SURE_CONFIDENCE = 0.9
"""Confidence of a text from which plates with other texts are ruled out."""

_MISREAD_FRACTION = 0.5  # fraction of the gate within which a plate may have been misread


def gate_mm(sigma_mm: float | None) -> float:
    """Return the gate for a plate's distance; `sigma_mm` is that of the robot's position, None if unknown."""
    if sigma_mm is None or not math.isfinite(sigma_mm):
        return (MIN_GATE_MM + MAX_GATE_MM) / 2.0
    return min(max(GATE_SIGMAS * sigma_mm, MIN_GATE_MM), MAX_GATE_MM)


def match_plate(
    place: tuple[float, float],
    observation: PlateObservation,
    text: str,
    confidence: float,
    plates: Sequence[Plate],
    *,
    gate: float,
    taken: Iterable[str] = (),
) -> Plate | None:
    """Return the plate of the map that matches an observed plate, or None without a match.

    Args:
        place: x and y in mm.
        observation: one observation of it, from the robot's estimated pose.
        text: its text, "" if unread.
        confidence: the confidence of the text.
        plates: the plates of the map.
        gate: maximum distance from its position in the map, along the wall, in mm; twice that across the
            wall, as distances are measured less accurately.
        taken: doors of the plates that are matched already.
    """
    taken_doors = set(taken)
    candidates: list[tuple[float, Plate]] = []
    for plate in plates:
        if plate.door in taken_doors or not _is_faced(plate, observation):
            continue
        distance = _distance_mm(plate, place)
        if distance < gate and (
            plate.text == text or confidence < SURE_CONFIDENCE or distance < _MISREAD_FRACTION * gate
        ):
            # A plate with the text that was read is preferred to a nearer one.
            candidates.append((distance - (gate if plate.text == text and text else 0.0), plate))
    return min(candidates, key=lambda match: match[0])[1] if candidates else None


def _is_faced(plate: Plate, observation: PlateObservation) -> bool:
    return abs(math.remainder(observation.axis_deg - plate.heading_deg, 360.0)) < MAX_FACING_DEG


def _distance_mm(plate: Plate, place: tuple[float, float]) -> float:
    """Return the larger of a position's distance from a plate along the wall and half of that across it."""
    facing = math.radians(plate.heading_deg)
    dx, dy = place[0] - plate.center.x, place[1] - plate.center.y
    across, along = (
        -math.sin(facing) * dx + math.cos(facing) * dy,
        math.cos(facing) * dx + math.sin(facing) * dy,
    )
    return max(abs(along), abs(across) / 2.0)
