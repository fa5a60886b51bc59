"""The position of a camera relative to a marker, from one image, and the resulting pose of the robot.

The edges of a marker are points on a straight line with known distances. An edge seen in column r (in focal
lengths to the right of the axis) satisfies r (z + t s) = x + t c: x to the right and z ahead is the center of
the marker, (c, s) its direction, and t the position of the edge along it. This is linear in x, z and s for
c = 1, so three edges suffice, and more are better. So one image gives the bearing, the distance and, as the
nearer half of a marker looks wider, the turn of the camera that would face the doors squarely.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from colony.nav.maps.signs import MARKER_BITS, MARKER_WIDTH_MM, STRIPE_MM, Marker
from colony.nav.pose.fixes import Row
from colony.runtime.library.robot import Position
from colony.vision.detections import MarkerBox
from colony.vision.level_camera import AHEAD, LevelCamera

EDGE_SIGMA_PX = 0.12
"""Standard deviation of an edge that many rows agree on."""

BEARING_SIGMA_DEG = 0.2
"""Standard deviation of the error of a bearing due to the camera's mounting and the time of the image."""

DISTANCE_SIGMA = 0.01
"""Standard deviation of a distance from the focal length, as a fraction of the distance."""

MAX_SLANT_SIGMA_DEG = 2.0
"""Maximum standard deviation of a marker's slant for a fix of distance and slant.

From farther away, distance and slant cannot be separated, and neither is reported.
"""

MAX_FACING_DEG = 70.0
"""Maximum slant at which a marker is visible."""


_UNITS = 2 * MARKER_BITS + 1


class MarkerPose(NamedTuple):
    """A marker relative to the robot, with standard deviations.

    Attributes:
        bearing_deg: direction of its center, counterclockwise from ahead.
        distance_mm: its distance.
        facing_deg: turn that makes the robot face the doors squarely, counterclockwise.
    """

    bearing_deg: float
    distance_mm: float
    facing_deg: float
    bearing_sigma_deg: float
    distance_sigma_mm: float
    facing_sigma_deg: float

    @property
    def aside_mm(self) -> float:
        """Distance of the robot to the left of the marker's normal, as seen facing the doors."""
        return self.distance_mm * math.sin(math.radians(self.facing_deg - self.bearing_deg))

    @property
    def ahead_mm(self) -> float:
        """Perpendicular distance of the robot from the doors."""
        return self.distance_mm * math.cos(math.radians(self.facing_deg - self.bearing_deg))


def edge_units(code: int) -> tuple[float, ...]:
    """Return the edges of a code's stripes, in units from the marker's left side."""
    black = [True]
    for bit in range(MARKER_BITS):
        black += [bool(code >> (MARKER_BITS - 1 - bit) & 1), True]
    inner = [float(k) for k in range(1, _UNITS) if black[k] != black[k - 1]]
    return (0.0, *inner, float(_UNITS))


def marker_pose(box: MarkerBox, camera: LevelCamera = AHEAD) -> MarkerPose | None:
    """Return the pose of the marker in a box, or None if no marker has such edges."""
    units = edge_units(box.code)
    if len(box.edges) != len(units):
        return None
    edges_mm = (np.array(units) - _UNITS / 2.0) * STRIPE_MM
    rays = (np.array(box.edges) - (camera.columns - 1) / 2.0) / camera.focal
    # r z + t r s - x = t, with c = 1: the unknowns are scaled by 1 / c.
    terms = np.stack([rays, edges_mm * rays, -np.ones_like(rays)], axis=1)
    (ahead, slant, right), _, rank, _ = np.linalg.lstsq(terms, edges_mm, rcond=None)
    if rank < 3 or not ahead > 0.0:
        return None
    cosine = 1.0 / math.hypot(1.0, slant)
    facing = math.degrees(math.atan(slant))
    if abs(facing) > MAX_FACING_DEG:
        return None
    reach = math.hypot(ahead, right)
    distance = reach * cosine
    edge_mm = EDGE_SIGMA_PX / camera.focal * ahead  # an edge's error along the marker
    covariance = np.linalg.inv(terms.T @ terms) * edge_mm**2
    gradient = np.array([ahead / reach, -slant * cosine**2 * reach, right / reach]) * cosine
    distance_error = math.sqrt(gradient @ covariance @ gradient)
    return MarkerPose(
        bearing_deg=camera.yaw_deg - math.degrees(math.atan2(right, ahead)),
        distance_mm=distance,
        facing_deg=camera.yaw_deg + facing,
        bearing_sigma_deg=math.hypot(BEARING_SIGMA_DEG, math.degrees(EDGE_SIGMA_PX / camera.focal)),
        distance_sigma_mm=math.hypot(distance_error, DISTANCE_SIGMA * distance),
        facing_sigma_deg=math.hypot(BEARING_SIGMA_DEG, math.degrees(math.sqrt(covariance[1, 1]) * cosine**2)),
    )


def marker_rows(pose: MarkerPose, marker: Marker, here: Position) -> tuple[Row, ...]:
    """Return the measurements of the robot's pose by a known marker.

    They are the bearing and, near the marker, the distance and the heading. `here` is the robot's estimated
    position.
    """
    heading = math.radians(here.heading)
    east, north = marker.center.x - here.x, marker.center.y - here.y
    map_distance = max(math.hypot(east, north), MARKER_WIDTH_MM)
    # The marker is along theta = atan2(-east, north), and seen at theta - heading.
    theta = math.atan2(-east, north)
    bearing_error = math.remainder(math.radians(pose.bearing_deg) + heading - theta, math.tau)
    cx, cy = north / map_distance**2, -east / map_distance**2
    bearing = Row(
        cx,
        cy,
        -1.0,
        cx * here.x + cy * here.y - heading + bearing_error,
        math.radians(pose.bearing_sigma_deg),
    )
    ux, uy = -east / map_distance, -north / map_distance
    excess_mm = pose.distance_mm - math.hypot(east, north)
    distance = Row(ux, uy, 0.0, ux * here.x + uy * here.y + excess_mm, pose.distance_sigma_mm)
    turned = math.remainder(math.radians(marker.heading_deg - pose.facing_deg) - heading, math.tau)
    facing = Row(0.0, 0.0, 1.0, heading + turned, math.radians(pose.facing_sigma_deg))
    return (bearing, distance, facing) if pose.facing_sigma_deg <= MAX_SLANT_SIGMA_DEG else (bearing,)
