"""The plates and markers of a map in the view of a camera at a pose, and their positions in its image.

Doors are assumed to be closed, and people absent.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from colony.nav.maps.signs import (
    PLATE_HEIGHT_MM,
    SIGN_HEIGHT_MM,
    STRIPE_HEIGHT_MM,
    Marker,
    Plate,
    markers_of,
    plates_of,
)
from colony.nav.maps.stickrep.geometry import Point, direction
from colony.nav.maps.stickrep.model import Map
from colony.nav.maps.walls import free_distance, walls_of
from colony.vision.detections import Corner
from colony.vision.level_camera import LevelCamera

_MIN_DEPTH_MM = 50.0
_SLACK_MM = 20.0


class SignInView(NamedTuple):
    """A sign in an image: its corners in pixels, clockwise from the upper left, and its distance."""

    sign: Plate | Marker
    corners: tuple[Corner, Corner, Corner, Corner]
    distance_mm: float


def signs_in_view(
    floor: Map, pose: tuple[float, float, float], camera: LevelCamera
) -> tuple[SignInView, ...]:
    """Return the signs that are entirely in the image and not hidden by a wall, the nearest one first.

    Args:
        floor: the map.
        pose: pose of the robot, x and y in mm, heading in degrees.
        camera: the camera.
    """
    segments = walls_of(floor).segments
    seen = []
    signs: tuple[Plate | Marker, ...] = (*plates_of(floor), *markers_of(floor))
    for sign in signs:
        corners = corners_of(sign, pose, camera)
        if corners is None or not all(_inside(corner, camera) for corner in corners):
            continue
        dx, dy = sign.center.x - pose[0], sign.center.y - pose[1]
        distance = math.hypot(dx, dy)
        ray = Point(dx / distance, dy / distance)
        if free_distance(segments, Point(pose[0], pose[1]), ray) >= distance - _SLACK_MM:
            seen.append(SignInView(sign, corners, distance))
    return tuple(sorted(seen, key=lambda view: view.distance_mm))


def corners_of(
    sign: Plate | Marker, pose: tuple[float, float, float], camera: LevelCamera
) -> tuple[Corner, Corner, Corner, Corner] | None:
    """Return the corners of a sign in the image, clockwise from the upper left, even if the sign is hidden.

    None if the camera is behind the sign, or a corner is less than 50 mm ahead of the camera.
    """
    width = sign.end_mm - sign.start_mm
    height = PLATE_HEIGHT_MM if isinstance(sign, Plate) else STRIPE_HEIGHT_MM
    ahead, into = direction(pose[2] + camera.yaw_deg), direction(sign.heading_deg)
    if (sign.center.x - pose[0]) * into.x + (sign.center.y - pose[1]) * into.y <= 0.0:
        return None
    ends = []
    for half in (-width / 2, width / 2):  # the left end first, facing the sign
        dx = sign.center.x + half * into.y - pose[0]
        dy = sign.center.y - half * into.x - pose[1]
        depth, right = dx * ahead.x + dy * ahead.y, dx * ahead.y - dy * ahead.x
        if depth < _MIN_DEPTH_MM:
            return None
        column = (camera.columns - 1) / 2.0 + camera.focal * right / depth
        rows = [camera.row_of(SIGN_HEIGHT_MM + side * height / 2, depth) for side in (1.0, -1.0)]
        ends.append((column, *rows))
    (left, left_top, left_bottom), (right, right_top, right_bottom) = ends
    return (left, left_top), (right, right_top), (right, right_bottom), (left, left_bottom)


def _inside(corner: Corner, camera: LevelCamera) -> bool:
    return -0.5 <= corner[0] <= camera.columns - 0.5 and -0.5 <= corner[1] <= camera.rows - 0.5
