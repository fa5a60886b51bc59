"""Rays of a level camera, and the gray levels of the pixels that they paint."""

from __future__ import annotations

import math
from typing import NamedTuple

from colony.sim.cameras.surfaces import Lighting
from colony.sim.compiled import Floats, inlined

_HALF_LIGHT_MM = 12_000.0  # distance at which brightness is halved


class Lens(NamedTuple):
    """A level camera in the renderer's form.

    It has the focal length in pixels, heights in mm, the yaw in radians, the hull of other robots, the rays
    per column, and the exposure in seconds.
    """

    focal: float
    above_floor: float
    yaw: float
    robot_radius: float
    robot_height: float
    rays: int
    exposure: float


class Eye(NamedTuple):
    """A camera at one moment: its position, its heading (sine and cosine), and the row of its optical axis.

    The row is relative to the first row drawn.
    """

    x: float
    y: float
    sine: float
    cosine: float
    axis: float


class Ray(NamedTuple):
    """A ray: its start, and its direction in the world's frame per mm of depth.

    `right` is its slope to the right of the optical axis. The ray represents everything up to `half` to
    either side.
    """

    x: float
    y: float
    dx: float
    dy: float
    length: float
    right: float
    half: float


@inlined
def level_of(shade: float, distance: float) -> float:
    """Return the gray level of a shade at a distance."""
    return 255.0 * shade / (1.0 + distance / _HALF_LIGHT_MM)


@inlined
def light_at(x: float, y: float, lighting: Lighting) -> float:
    """Return the light level at (x, y)."""
    columns, rows = lighting.levels.shape
    across = min(max((x - lighting.x) / lighting.cell, 0.0), columns - 1.0)
    along = min(max((y - lighting.y) / lighting.cell, 0.0), rows - 1.0)
    column, row = int(across), int(along)
    right, above = min(column + 1, columns - 1), min(row + 1, rows - 1)
    across, along = across - column, along - row
    low: float = lighting.levels[column, row] * (1.0 - across) + lighting.levels[right, row] * across
    high: float = lighting.levels[column, above] * (1.0 - across) + lighting.levels[right, above] * across
    level: float = low * (1.0 - along) + high * along
    return level


@inlined
def row_below(height: float, depth: float, axis: float, lens: Lens, rows: int) -> int:
    """Return the first row that sees points below `height` at `depth`, clamped to 0 to `rows`."""
    row = axis - lens.focal * (height - lens.above_floor) / depth
    return int(min(max(math.ceil(row), 0.0), rows + 0.0))


@inlined
def paint(column: Floats, start: int, end: int, level: float) -> None:
    """Set the pixels from `start` up to `end` of a column to a level."""
    for row in range(start, end):
        column[row] = level
