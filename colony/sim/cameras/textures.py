"""The materials of walls, as pictures that repeat horizontally and are as high as the wall.

Shades are from 0 (black) to 1. The materials are painted blocks with joints, bare bricks, glass bricks with
light behind them, plaster, tile, steel, glass and windows. Each is drawn from a fixed seed.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from colony.sim.cameras.atlas import AtlasPicture
from colony.sim.compiled import Floats2

TEXEL_MM = 5.0

_PLASTER = 0.78
_CACHED_HEIGHTS = (
    2  # number of wall heights for which pictures are cached, 3 MB each; a building has one height
)


def _grid(width_mm: float, height_mm: float) -> tuple[Floats2, Floats2]:
    """Return the centers of all texels, from the left and from the floor, in mm."""
    across = (np.arange(round(width_mm / TEXEL_MM)) + 0.5) * TEXEL_MM
    up = height_mm - (np.arange(round(height_mm / TEXEL_MM)) + 0.5) * TEXEL_MM
    columns, rows = np.meshgrid(across, up)
    return columns, rows


def _pattern(shades: Floats2, height_mm: float, darkest: float = 0.0) -> AtlasPicture:
    """Return the picture of a wall section that repeats horizontally."""
    shades = np.clip(shades, darkest, 1.0)
    return AtlasPicture(shades=shades, width_mm=shades.shape[1] * TEXEL_MM, height_mm=height_mm, wraps=True)


def _smooth_noise(shape: tuple[int, int], cells: tuple[int, int], rng: np.random.Generator) -> Floats2:
    """Return smooth periodic noise of standard deviation 1, with this number of cells down and across."""
    spectrum = np.fft.rfft2(rng.standard_normal(shape))
    down, across = np.fft.fftfreq(shape[0]) * shape[0], np.fft.rfftfreq(shape[1]) * shape[1]
    spectrum *= np.exp(-((down[:, None] / cells[0]) ** 2) - (across[None, :] / cells[1]) ** 2)
    spectrum[0, 0] = 0.0
    noise: Floats2 = np.fft.irfft2(spectrum, s=shape)
    noise /= noise.std()
    return noise


def _blocks(
    across: Floats2, up: Floats2, block: tuple[float, float], *, staggered: bool
) -> tuple[Floats2, Floats2, Floats2, Floats2]:
    """Return the course and the block of each texel, and its distances from the block's edge.

    The distances, to the side and up or down, are in mm.
    """
    wide, high = block
    course = np.floor(up / high)
    shifted = across + (wide / 2 * (course % 2) if staggered else 0.0)
    number = np.floor(shifted / wide)
    aside, above = shifted - number * wide, up - course * high
    return course, number, np.minimum(aside, wide - aside), np.minimum(above, high - above)


def _masonry(
    *, block: tuple[float, float], columns: int, height_mm: float, shade: float, joint: float,
    joint_mm: float, spread: float, seed: int,
) -> AtlasPicture:  # fmt: skip
    rng = np.random.default_rng(seed)
    width_mm = columns * block[0]
    across, up = _grid(width_mm, height_mm)
    course, number, aside, above = _blocks(across, up, block, staggered=True)
    block_deviations = rng.standard_normal((int(course.max()) + 1, columns))
    shades = shade + spread * block_deviations[course.astype(int), number.astype(int) % columns]
    shades += 0.012 * _smooth_noise(shades.shape, (12, 16), rng)
    in_joint = np.clip((joint_mm / 2 + 1.5 - np.minimum(aside, above)) / 3.0, 0.0, 1.0)
    shades += in_joint * (joint - shades)
    return _pattern(shades, height_mm)


@lru_cache(maxsize=_CACHED_HEIGHTS)
def painted_brick(height_mm: float) -> AtlasPicture:
    """Draw concrete blocks of 406 by 203 mm, painted over: joints show as shallow lines."""
    return _masonry(
        block=(405.0, 203.0), columns=8, height_mm=height_mm, shade=0.74, joint=0.60, joint_mm=10.0,
        spread=0.010, seed=11,
    )  # fmt: skip


@lru_cache(maxsize=_CACHED_HEIGHTS)
def bare_brick(height_mm: float) -> AtlasPicture:
    """Draw bricks of 203 by 67 mm, unpainted, with pale joints."""
    return _masonry(
        block=(205.0, 68.0), columns=16, height_mm=height_mm, shade=0.42, joint=0.58, joint_mm=10.0,
        spread=0.045, seed=12,
    )  # fmt: skip


@lru_cache(maxsize=_CACHED_HEIGHTS)
def glass_brick(height_mm: float) -> AtlasPicture:
    """Draw glass blocks of 200 by 200 mm in dark joints.

    The light behind them is uneven: groups are bright, others dark, and each block has a pale rim and a
    darker center, or vice versa.
    """
    rng = np.random.default_rng(13)
    size, columns = 200.0, 20
    across, up = _grid(size * columns, height_mm)
    course, number, aside, above = _blocks(across, up, (size, size), staggered=False)
    rows, cols = course.astype(int), number.astype(int) % columns
    block_rows = int(course.max()) + 1
    light_behind = 0.50 + 0.20 * _smooth_noise((block_rows, columns), (3, 4), rng)
    light_behind += 0.10 * rng.standard_normal((block_rows, columns))
    light_behind = np.where(
        rng.random(light_behind.shape) < 0.14, 0.10, light_behind
    )  # something dark stands behind these blocks
    rim = 0.10 * rng.standard_normal((block_rows, columns))
    inside = np.clip(np.minimum(aside, above) / (size / 2), 0.0, 1.0)
    shades = light_behind[rows, cols] + rim[rows, cols] * (0.5 - inside)
    shades += 0.03 * _smooth_noise(shades.shape, (40, 60), rng)
    in_joint = np.clip((7.0 - np.minimum(aside, above)) / 3.0, 0.0, 1.0)
    shades += in_joint * (0.16 - shades)
    return _pattern(shades, height_mm, 0.03)


@lru_cache(maxsize=_CACHED_HEIGHTS)
def plaster(height_mm: float) -> AtlasPicture:
    """Draw a plain wall, a little uneven."""
    rng = np.random.default_rng(14)
    shape = (round(height_mm / TEXEL_MM), 640)
    shades = (
        _PLASTER + 0.010 * _smooth_noise(shape, (10, 12), rng) + 0.008 * _smooth_noise(shape, (120, 140), rng)
    )
    return _pattern(shades, height_mm)


@lru_cache(maxsize=_CACHED_HEIGHTS)
def tile(height_mm: float) -> AtlasPicture:
    """Draw slabs of 300 by 300 mm with fine dark joints: tile, marble, sandstone."""
    return _masonry(
        block=(300.0, 300.0), columns=10, height_mm=height_mm, shade=0.66, joint=0.45, joint_mm=5.0,
        spread=0.03, seed=15,
    )  # fmt: skip


@lru_cache(maxsize=_CACHED_HEIGHTS)
def steel(height_mm: float) -> AtlasPicture:
    """Draw brushed steel: soft upright streaks, paler above than below."""
    rng = np.random.default_rng(16)
    shape = (round(height_mm / TEXEL_MM), 400)
    streaks = _smooth_noise((1, shape[1]), (1, 90), rng) * 0.012
    slope = np.linspace(0.04, -0.04, shape[0])[:, None]
    shades = 0.62 + slope + streaks + 0.02 * _smooth_noise(shape, (3, 4), rng)
    return _pattern(shades, height_mm)


@lru_cache(maxsize=_CACHED_HEIGHTS)
def window(height_mm: float) -> AtlasPicture:
    """Draw panes of 900 mm from 900 mm above the floor on, in dark frames, with daylight behind them."""
    across, up = _grid(3600.0, height_mm)
    rng = np.random.default_rng(17)
    pane = (up > 900.0) & (up < 2400.0)
    outside = 0.86 + 0.07 * _smooth_noise(across.shape, (4, 6), rng)
    aside = across % 900.0
    frame = np.minimum(aside, 900.0 - aside) < 30.0
    frame |= (np.abs(up - 900.0) < 30.0) | (np.abs(up - 2400.0) < 30.0)
    shades = np.where(pane, outside, _PLASTER)
    return _pattern(np.where(frame & (up > 870.0) & (up < 2430.0), 0.25, shades), height_mm)


@lru_cache(maxsize=_CACHED_HEIGHTS)
def glass(height_mm: float) -> AtlasPicture:
    """Draw panes of clear glass in steel frames: the room behind them is dim, with soft reflections."""
    across, up = _grid(3600.0, height_mm)
    rng = np.random.default_rng(18)
    aside = across % 900.0
    frame = (np.minimum(aside, 900.0 - aside) < 35.0) | (np.abs(up - 1000.0) < 40.0)
    frame |= (up < 120.0) | (up > 2040.0)
    light_behind = 0.36 + 0.10 * _smooth_noise(across.shape, (5, 7), rng)
    return _pattern(np.where(frame, 0.55, light_behind), height_mm, 0.05)


@lru_cache(maxsize=_CACHED_HEIGHTS)
def shelves(height_mm: float) -> AtlasPicture:
    """Draw the wall of a room: shelves full of books up to 1.9 m, 1.6 m wide, then 1.6 m of plain wall."""
    rng = np.random.default_rng(19)
    across, up = _grid(3200.0, height_mm)
    shades = 0.66 + 0.012 * _smooth_noise(across.shape, (10, 12), rng)
    books = rng.uniform(0.08, 0.75, size=(6, 40))
    tops = rng.uniform(190.0, 290.0, size=(6, 40))
    shelf, spine = np.floor(up / 320.0).astype(int), np.floor(across / 40.0).astype(int)
    on_shelf = (across < 1600.0) & (up < 1920.0)
    shelf, spine = np.minimum(shelf, 5), np.minimum(spine, 39)
    is_book = on_shelf & (up % 320.0 > 25.0) & (up % 320.0 < tops[shelf, spine])
    shades = np.where(on_shelf, 0.10, shades)
    shades = np.where(is_book, books[shelf, spine], shades)
    board = on_shelf & ((up % 320.0 <= 25.0) | (across % 800.0 < 25.0))
    return _pattern(np.where(board, 0.40, shades), height_mm)
