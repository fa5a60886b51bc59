"""Simulated views of a flat object on a wall by a level camera, and the box that a detector may find."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from colony.nav.maps.signs import CHARACTER_HEIGHT_MM, PLATE_HEIGHT_MM, PLATE_WIDTH_MM
from colony.vision.level_camera import SIDE
from colony.vision.plates.reader import Corners

Gray = npt.NDArray[np.uint8]
Doubles = npt.NDArray[np.float64]

LOWEST_PX, HIGHEST_PX = 6.5, 42.0
"""Range of the height of characters in the views for the training, in pixels."""

_MAX_SLANT_DEG = 52.0
_MARGIN_PX = 6
_FINENESS = 3


class View(NamedTuple):
    """A part of a camera's image, and the object's corners in it, clockwise from the upper left."""

    image: Gray
    corners: Corners


def random_height(random: np.random.Generator) -> float:
    """Draw a height of characters in pixels; small ones, which are hard to read, most often."""
    if random.random() < 0.7:
        return float(random.uniform(LOWEST_PX, 16.0))
    return float(random.uniform(16.0, HIGHEST_PX))


def view(
    picture: Gray, height_px: float, random: np.random.Generator, slant_deg: float | None = None
) -> View:
    """Return a picture of the size of a plate as a camera sees it.

    Args:
        picture: the picture.
        height_px: height of its characters in the view.
        random: the generator.
        slant_deg: the angle between the wall's normal and the camera's axis; the default is a random one up
            to 52.
    """
    import cv2

    if slant_deg is None:
        slant_deg = float(np.clip(random.normal(0.0, 22.0), -_MAX_SLANT_DEG, _MAX_SLANT_DEG))
    corners = _projected(height_px, slant_deg, random)
    low = np.floor(corners.min(axis=0)) - _MARGIN_PX
    columns, rows = (np.ceil(corners.max(axis=0)) + _MARGIN_PX - low).astype(int).tolist()
    corners = corners - low + random.uniform(-0.5, 0.5, 2)
    tall, wide = picture.shape
    source = np.array([[0, 0], [wide, 0], [wide, tall], [0, tall]], np.float32) - np.float32(0.5)
    target = ((corners + 0.5) * _FINENESS - 0.5).astype(np.float32)
    fine = _wall(rows * _FINENESS, columns * _FINENESS, random)
    size = (columns * _FINENESS, rows * _FINENESS)
    transform = cv2.getPerspectiveTransform(source, target)
    seen = cv2.warpPerspective(
        picture, transform, size, dst=fine, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT
    )
    cells = seen.reshape(rows, _FINENESS, columns, _FINENESS).mean(axis=(1, 3), dtype=np.float32)
    return View(_exposed(cells, random), _corners(corners))


def jittered(corners: Corners, random: np.random.Generator) -> Corners:
    """Return the corners as a detector may find them.

    Each corner is off by about a pixel, and all of them together by a few percent of the plate's size.
    """
    true = np.array(corners)
    size = true.max(axis=0) - true.min(axis=0)
    together = random.normal(0.0, 0.015, 2) * size
    growth = random.normal(0.0, 0.015, 2) * (true - true.mean(axis=0))
    return _corners(true + together + growth + random.normal(0.0, random.uniform(0.1, 0.8), (4, 2)))


def misplaced(corners: Corners, random: np.random.Generator) -> Corners:
    """Draw a box that holds only a part of the plate, or much more than the plate."""
    true = np.array(corners)
    along, down = true[1] - true[0], true[3] - true[0]
    match int(random.integers(4)):
        case 0:
            sign = 1.0 if random.random() < 0.5 else -1.0
            moved = true + sign * random.uniform(0.25, 0.7) * along
        case 1:
            moved = true + (1.0 if random.random() < 0.5 else -1.0) * random.uniform(0.35, 0.8) * down
        case 2:
            kept = random.uniform(0.3, 0.72)
            start = 0.0 if random.random() < 0.5 else 1.0 - kept
            left, right = true[[0, 3]] + start * along, true[[0, 3]] + (start + kept) * along
            moved = np.array([left[0], right[0], right[1], left[1]])
        case _:
            center = true.mean(axis=0)
            moved = center + (true - center) * random.uniform(1.5, 2.5)
    return _corners(moved)


def _projected(height_px: float, slant_deg: float, random: np.random.Generator) -> Doubles:
    """Return the plate's corners in the image, (4, 2), the optical axis being the origin."""
    depth = CHARACTER_HEIGHT_MM * SIDE.focal / height_px
    slant = math.radians(slant_deg)
    across = random.uniform(-0.5, 0.5) * depth
    corners = np.empty((4, 2))
    for i, (side, up) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
        x = across + side * PLATE_WIDTH_MM / 2.0 * math.cos(slant)
        z = depth + side * PLATE_WIDTH_MM / 2.0 * math.sin(slant)
        corners[i] = x * SIDE.focal / z, up * PLATE_HEIGHT_MM / 2.0 * SIDE.focal / z
    roll = math.radians(random.normal(0.0, 0.8))
    turned = np.array([[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]])
    center = corners.mean(axis=0)
    result: Doubles = (corners - center) @ turned + center
    return result


def _wall(rows: int, columns: int, random: np.random.Generator) -> Gray:
    """Draw a wall, with the edge of something on it now and then."""
    shade = random.uniform(40.0, 240.0)
    wall = np.full((rows, columns), shade, np.float32)
    wall += np.linspace(0.0, random.uniform(-30.0, 30.0), columns, dtype=np.float32)
    if random.random() < 0.4:
        edge = int(random.uniform(0.0, columns))
        beyond = slice(edge, None) if random.random() < 0.5 else slice(None, edge)
        wall[:, beyond] = random.uniform(0.0, 255.0)
    return np.clip(wall, 0.0, 255.0).astype(np.uint8)


def _exposed(image: npt.NDArray[np.float32], random: np.random.Generator) -> Gray:
    """Return the sensor's image: blurred by lens and motion, uneven, brighter or darker, grainy."""
    import cv2

    lens, motion = random.uniform(0.0, 0.75), random.uniform(0.0, 1.2)
    if lens > 0.2:
        image = np.asarray(cv2.GaussianBlur(image, (5, 5), lens), np.float32)
    if motion > 0.3:
        side = motion / 2.0 / (1.0 + motion)
        image = np.asarray(cv2.filter2D(image, -1, np.array([[side, 1.0 - 2.0 * side, side]])), np.float32)
    gain, offset = random.uniform(0.35, 1.25), random.uniform(0.0, 30.0)
    falloff = np.linspace(1.0, random.uniform(0.75, 1.25), image.shape[1], dtype=np.float32)
    grain = random.normal(0.0, random.uniform(0.5, 6.0), image.shape)
    return np.clip(image * falloff * gain + offset + grain, 0.0, 255.0).astype(np.uint8)


def _corners(points: Doubles) -> Corners:
    a, b, c, d = ((float(x), float(y)) for x, y in points.tolist())
    return a, b, c, d
