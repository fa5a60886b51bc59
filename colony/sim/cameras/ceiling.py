"""The camera that looks up: an image of the ceiling with its lights, in shades of gray.

The camera is on the robot's axis. Columns of the image increase in the direction of travel, rows to the
right, so that a row is a line along the corridor, which reaches a light at its leading edge (thesis section
5.6). The ceiling is a plane, so a pixel sees one point of it: the tile, the sunlight on it, and possibly a
light. The lens blurs edges and darkens the corners.

Noise is counter-based: it depends on the seed, the time of the image and the pixel, so that rows rendered
alone are the same as in the whole image.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import NamedTuple

import numpy as np

from colony.body import devices
from colony.body.shipped import shipped_body
from colony.sim.cameras.grain import QUANTILES, quantiles
from colony.sim.chance import PIXELS, SEED_MODULUS, random_bits
from colony.sim.compiled import Bytes2, Floats, Floats2, Ints, compiled, inlined
from colony.sim.hazards.scenery import CeilingLight, Scenery, SunBand

LIGHT_ALONG_MM, LIGHT_ACROSS_MM = 600.0, 1200.0

_CEILING_LEVEL = 70.0
_LIGHT_LEVEL = 180.0  # excess of a light over the ceiling
_OUT_LEVEL = -12.0  # level of a light that is out, relative to the ceiling
_TILE_MM, _TILE_LEVELS = 600.0, 6.0
_SEAM_MM, _SEAM_LEVEL = 12.0, -18.0  # half the width of the grid that holds the tiles
_SUN_BLUR_MM = 60.0
_MAX_NEAR = 32
_TILES = 64  # period of the pattern of tiles


@dataclass(frozen=True, slots=True, kw_only=True)
class CeilingCameraConfig:
    """The configuration of a camera that looks straight up, with columns along the direction of travel.

    Attributes:
        width, height: size of the image in pixels.
        along_deg, across_deg: fields of view of the width and the height.
        below_ceiling_mm: distance of the lens from the ceiling.
        blur_mm: blur on the ceiling; edges are ramps of twice this width.
        vignetting: fraction by which the corners are darker.
        noise: standard deviation of a pixel, in gray levels.

    Raises:
        ValueError: a number is not finite, or out of range.
    """

    width: int
    height: int
    along_deg: float
    across_deg: float
    below_ceiling_mm: float
    blur_mm: float = 16.0
    vignetting: float = 0.22
    noise: float = 2.5

    def __post_init__(self) -> None:
        """Check the ranges of the parameters."""
        ranges = {"along_deg": (1.0, 170.0), "across_deg": (1.0, 170.0), "vignetting": (0.0, 1.0)}
        ranges |= {"blur_mm": (0.1, 1000.0), "noise": (0.0, 255.0), "below_ceiling_mm": (100.0, 1e5)}
        ranges |= {"width": (1.0, 4000.0), "height": (1.0, 4000.0)}
        for field in fields(self):
            value, (low, high) = getattr(self, field.name), ranges[field.name]
            if not low <= value <= high:
                raise ValueError(f"{field.name} is {value!r}; expected {low:g} to {high:g}")


def ceiling_config_of(camera: devices.CeilingCameraSpec) -> CeilingCameraConfig:
    """Return the configuration of a camera of a robot's body."""
    return CeilingCameraConfig(
        width=camera.size.columns,
        height=camera.size.rows,
        along_deg=camera.along_deg,
        across_deg=camera.across_deg,
        below_ceiling_mm=camera.below_ceiling_mm,
    )


@cache
def rome_ceiling_camera() -> CeilingCameraConfig:
    """Return the configuration of RoME's camera that looks up."""
    return ceiling_config_of(shipped_body("rome").ceiling_camera())


class CeilingModel(NamedTuple):
    """A ceiling in the renderer's form, with work space.

    Attributes:
        lights: (n, 7), x, y, the unit vector along the corridor, half the length along it and across, and
            the excess over the ceiling in gray levels.
        sun: (m, 7), x, y, the unit vector of the length, half the length and width, and the excess.
        tiles: (64, 64), the deviation of each tile in gray levels.
        quantiles: (4096,), quantiles of the normal distribution.
        near_lights, near_sun: (32,), the indices of nearby lights and sun bands.
        level, hidden: (width,), a row of gray levels, and the fraction of each pixel covered by lights.
        seed: seed of the noise.
    """

    lights: Floats2
    sun: Floats2
    tiles: Floats2
    quantiles: Floats
    near_lights: Ints
    near_sun: Ints
    level: Floats
    hidden: Floats
    seed: int


class UpwardLens(NamedTuple):
    """A ceiling camera in the renderer's form.

    It has the mm of ceiling per pixel, the center of the image, the blur, the vignetting and the noise.
    """

    along_mm: float
    across_mm: float
    center_column: float
    center_row: float
    blur: float
    vignetting: float
    noise: float


def ceiling_model(scenery: Scenery, width: int) -> CeilingModel:
    """Return the ceiling of a building in one run, for images of this width."""
    seed = scenery.seed % SEED_MODULUS
    return CeilingModel(
        lights=np.array([_light_row(light) for light in scenery.lights], dtype=np.float64).reshape(-1, 7),
        sun=np.array([_sun_row(band) for band in scenery.sun], dtype=np.float64).reshape(-1, 7),
        tiles=_TILE_LEVELS * (np.random.default_rng(seed).random((_TILES, _TILES)) - 0.5),
        quantiles=quantiles(),
        near_lights=np.zeros(_MAX_NEAR, dtype=np.int64),
        near_sun=np.zeros(_MAX_NEAR, dtype=np.int64),
        level=np.zeros(width),
        hidden=np.zeros(width),
        seed=seed,
    )


def lens_of(config: CeilingCameraConfig) -> UpwardLens:
    """Return a camera in the renderer's form."""
    half_along = config.below_ceiling_mm * math.tan(math.radians(config.along_deg) / 2)
    half_across = config.below_ceiling_mm * math.tan(math.radians(config.across_deg) / 2)
    return UpwardLens(
        along_mm=half_along / (config.width / 2),
        across_mm=half_across / (config.height / 2),
        center_column=(config.width - 1) / 2,
        center_row=(config.height - 1) / 2,
        blur=float(config.blur_mm),
        vignetting=float(config.vignetting),
        noise=float(config.noise),
    )


def _light_row(light: CeilingLight) -> tuple[float, ...]:
    angle = math.radians(light.heading_deg)
    level = _LIGHT_LEVEL * light.brightness if light.brightness > 0.0 else _OUT_LEVEL
    along = (-math.sin(angle), math.cos(angle))
    return (light.x_mm, light.y_mm, *along, LIGHT_ALONG_MM / 2, LIGHT_ACROSS_MM / 2, level)


def _sun_row(band: SunBand) -> tuple[float, ...]:
    angle = math.radians(band.heading_deg)
    along = (-math.sin(angle), math.cos(angle))
    return (band.x_mm, band.y_mm, *along, band.length_mm / 2, band.width_mm / 2, band.level)


@inlined
def _visible_fraction(depth: float, sharpness: float) -> float:
    """Return the visible fraction, 0 to 1, at `depth` inside a blurred edge (negative: outside)."""
    fraction = min(max(0.5 + depth * sharpness, 0.0), 1.0)
    return fraction * fraction * (3.0 - 2.0 * fraction)


@inlined
def _gather(x: float, y: float, reach: float, rectangles: Floats2, near: Ints) -> int:
    """Collect the indices of the rectangles that may be in view from (x, y) into `near`; return the count."""
    count = 0
    for number in range(rectangles.shape[0]):
        rectangle = rectangles[number]
        dx, dy = x - rectangle[0], y - rectangle[1]
        along, across = abs(dx * rectangle[2] + dy * rectangle[3]), abs(dy * rectangle[2] - dx * rectangle[3])
        if along < rectangle[4] + reach and across < rectangle[5] + reach and count < _MAX_NEAR:
            near[count] = number
            count += 1
    return count


@inlined
def _draw_tiles(x: float, y: float, dx: float, dy: float, blur: float, ceiling: CeilingModel) -> None:
    """Draw the tiles of a row of pixels, which see the points (x, y), (x + dx, y + dy) and so on."""
    sharpness = 1.0 / (2.0 * blur)
    east0, north0, east_step, north_step = x / _TILE_MM, y / _TILE_MM, dx / _TILE_MM, dy / _TILE_MM
    for column in range(ceiling.level.shape[0]):  # a loop that the compiler vectorizes
        east, north = east0 + column * east_step, north0 + column * north_step
        fraction_x, fraction_y = east - math.floor(east), north - math.floor(north)
        edge = _TILE_MM * min(min(fraction_x, 1.0 - fraction_x), min(fraction_y, 1.0 - fraction_y))
        ceiling.level[column] = _SEAM_LEVEL * _visible_fraction(_SEAM_MM - edge, sharpness)
        ceiling.hidden[column] = 0.0
    for column in range(ceiling.level.shape[0]):
        tile_x = math.floor(east0 + column * east_step) & (_TILES - 1)
        tile_y = math.floor(north0 + column * north_step) & (_TILES - 1)
        ceiling.level[column] += ceiling.tiles[tile_x, tile_y]


@inlined
def _add_rectangle(
    x: float, y: float, dx: float, dy: float, blur: float, rectangle: Floats, out: Floats, factor: float
) -> None:
    """Add `factor` times the visible fraction of a rectangle to each pixel of a row as in `_draw_tiles`."""
    ox, oy = x - rectangle[0], y - rectangle[1]
    along, along_step = ox * rectangle[2] + oy * rectangle[3], dx * rectangle[2] + dy * rectangle[3]
    across, across_step = oy * rectangle[2] - ox * rectangle[3], dy * rectangle[2] - dx * rectangle[3]
    half_along, half_across, sharpness = rectangle[4], rectangle[5], 1.0 / (2.0 * blur)
    for column in range(out.shape[0]):
        depth_along = half_along - abs(along + column * along_step)
        depth_across = half_across - abs(across + column * across_step)
        out[column] += (
            factor * _visible_fraction(depth_along, sharpness) * _visible_fraction(depth_across, sharpness)
        )


@inlined
def _expose(row: int, t_ns: int, ceiling: CeilingModel, lens: UpwardLens, out: Bytes2, index: int) -> None:
    """Convert row `row` of gray levels to row `index` of an image: darker at the rim, with noise."""
    down = (row - lens.center_row) / (lens.center_row + 0.5)
    bits, scale = np.uint64(0), 1.0 / (lens.center_column + 0.5)
    for column in range(out.shape[1]):
        if column % 4 == 0:  # sixteen bits for each of four pixels
            bits = random_bits(ceiling.seed, PIXELS, t_ns, row * 4096 + column)
        deviate = ceiling.quantiles[int(bits & np.uint64(QUANTILES - 1))]
        bits >>= np.uint64(16)
        right = (column - lens.center_column) * scale
        level = ceiling.level[column] * (1.0 - lens.vignetting * (right * right + down * down) / 2.0)
        out[index, column] = np.uint8(min(max(level + lens.noise * deviate + 0.5, 0.0), 255.0))


@compiled
def render_rows(
    x: float, y: float, heading_deg: float, t_ns: int, ceiling: CeilingModel, lens: UpwardLens, rows: Ints,
    image: Bytes2,
) -> None:  # fmt: skip
    """Draw some rows of the image of a robot's camera at (x, y).

    Args:
        x: position of the robot to the east, in mm.
        y: position of the robot to the north, in mm.
        heading_deg: heading of the robot.
        t_ns: time of the image.
        ceiling: the ceiling.
        lens: the camera.
        rows: (k,), the indices of the rows.
        image: (k, width), receives the rows, from 0 (black) to 255.
    """
    sine, cosine = math.sin(math.radians(heading_deg)), math.cos(math.radians(heading_deg))
    ahead = -lens.along_mm * lens.center_column
    reach = math.hypot(ahead, lens.across_mm * lens.center_row) + lens.blur + _SUN_BLUR_MM
    lights = _gather(x, y, reach, ceiling.lights, ceiling.near_lights)
    bands = _gather(x, y, reach, ceiling.sun, ceiling.near_sun)
    dx, dy = -lens.along_mm * sine, lens.along_mm * cosine
    for index in range(rows.shape[0]):
        left = (lens.center_row - rows[index]) * lens.across_mm
        px, py = x - ahead * sine - left * cosine, y + ahead * cosine - left * sine
        _draw_tiles(px, py, dx, dy, lens.blur, ceiling)
        for light in ceiling.near_lights[:lights]:
            _add_rectangle(px, py, dx, dy, lens.blur, ceiling.lights[light], ceiling.hidden, 1.0)
        for column in range(image.shape[1]):
            ceiling.level[column] = _CEILING_LEVEL + ceiling.level[column] * (1.0 - ceiling.hidden[column])
        for light in ceiling.near_lights[:lights]:
            lamp = ceiling.lights[light]
            _add_rectangle(px, py, dx, dy, lens.blur, lamp, ceiling.level, lamp[6])
        for band in ceiling.near_sun[:bands]:
            rectangle = ceiling.sun[band]
            _add_rectangle(px, py, dx, dy, lens.blur + _SUN_BLUR_MM, rectangle, ceiling.level, rectangle[6])
        _expose(rows[index], t_ns, ceiling, lens, image, index)


class CeilingCamera:
    """A camera that looks up, in a building. Stateful: reuses its work space."""

    def __init__(self, scenery: Scenery, config: CeilingCameraConfig | None = None) -> None:
        self.config = config or rome_ceiling_camera()
        self._ceiling, self._lens = ceiling_model(scenery, self.config.width), lens_of(self.config)
        self._all_rows = np.arange(self.config.height, dtype=np.int64)

    def image(self, pose: tuple[float, float, float], t_ns: int) -> Bytes2:
        """Return the image of a robot at a pose (x and y in mm, heading in degrees): (height, width)."""
        return self._draw(pose, t_ns, self._all_rows)

    def rows(self, pose: tuple[float, float, float], t_ns: int, rows: Sequence[int]) -> Bytes2:
        """Return only some rows of the image, (rows, width), which is much faster than all of them.

        Raises:
            ValueError: the image does not have one of the rows.
        """
        numbers = np.array(rows, dtype=np.int64).reshape(-1)
        if numbers.size and not 0 <= numbers.min() <= numbers.max() < self.config.height:
            raise ValueError(f"rows {list(rows)}; expected numbers from 0 to {self.config.height - 1}")
        return self._draw(pose, t_ns, numbers)

    def _draw(self, pose: tuple[float, float, float], t_ns: int, rows: Ints) -> Bytes2:
        image = np.empty((len(rows), self.config.width), dtype=np.uint8)
        render_rows(*pose, t_ns, self._ceiling, self._lens, rows, image)
        return image
