"""Pictures of people and fire extinguishers, transparent around their outlines."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.sim.cameras.atlas import Picture
from colony.sim.compiled import Floats2

PERSON_WIDTH_MM = 620.0
EXTINGUISHER_MM = (190.0, 560.0)
"""Width and height of a fire extinguisher."""

_TEXEL_MM = 5.0
_SHADES = (0.28, 0.34)  # red in shades of gray: the cylinder, and its highlight


class _PersonStyle(NamedTuple):
    height_mm: float
    coat: float
    legs: float
    skin: float
    hair: float
    skirt: bool


_PERSON_STYLES = (
    _PersonStyle(1780.0, 0.16, 0.24, 0.62, 0.12, False),
    _PersonStyle(1650.0, 0.55, 0.12, 0.68, 0.40, True),
    _PersonStyle(1860.0, 0.82, 0.30, 0.45, 0.08, False),
    _PersonStyle(1710.0, 0.36, 0.44, 0.58, 0.25, True),
)
PERSON_STYLES = len(_PERSON_STYLES)
"""Number of different people; each has two pictures, with legs together and apart."""

_Mask = NDArray[np.bool_]


@lru_cache(maxsize=1)
def people() -> tuple[Picture, ...]:
    """Return the pictures of people, numbered 2 * style + gait."""
    return tuple(_person(style, stride) for style in _PERSON_STYLES for stride in (0.0, 1.0))


def _person(style: _PersonStyle, stride: float) -> Picture:
    """Draw a person from the front: `stride` is 0 with the legs together, 1 with the legs apart."""
    rows, columns = round(style.height_mm / _TEXEL_MM), round(PERSON_WIDTH_MM / _TEXEL_MM)
    aside = (np.arange(columns) + 0.5) * _TEXEL_MM - PERSON_WIDTH_MM / 2
    x, y = np.meshgrid(aside, (rows - 0.5 - np.arange(rows)) * _TEXEL_MM / style.height_mm)
    shades, opacity = np.zeros_like(x), np.zeros(x.shape, dtype=np.bool_)

    def put(mask: _Mask, shade: float) -> None:
        shades[mask] = shade * (1.0 - 0.25 * np.minimum(np.abs(x[mask]) / 260.0, 1.0))
        opacity[mask] = True

    legs = (y < 0.50) & (np.abs(np.abs(x) - 75.0 - 90.0 * stride * (0.5 - y)) < 62.0 + 30.0 * y)
    put(legs & (y > 0.03), style.legs)
    put((y <= 0.045) & legs, 0.08)  # shoes
    hem = 0.28 if style.skirt else 0.42
    put((y >= hem) & (y < 0.83) & (np.abs(x) < _torso(y)), style.coat)
    arms = (np.abs(np.abs(x) - 245.0 - 20.0 * stride * (0.8 - y)) < 45.0) & (y > 0.42) & (y < 0.80)
    put(arms, style.coat * 0.85)
    hands = (np.abs(np.abs(x) - 250.0 - 8.0 * stride) < 38.0) & (y > 0.385) & (y <= 0.42)
    put(hands, style.skin)
    put((y >= 0.81) & (y < 0.88) & (np.abs(x) < 55.0), style.skin * 0.85)
    head = (x / 80.0) ** 2 + ((y - 0.93) / 0.07) ** 2 < 1.0
    put(head, style.skin)
    put(head & (y > 0.955 - 0.02 * np.abs(x) / 80.0), style.hair)
    return Picture(
        shades=np.clip(shades, 0.02, 1.0), opacity=opacity.astype(np.float64),
        width_mm=PERSON_WIDTH_MM, height_mm=rows * _TEXEL_MM,
    )  # fmt: skip


def _torso(y: Floats2) -> Floats2:
    """Return half the width of a coat at a fraction of the height: shoulders, waist, hem."""
    return np.interp(y, [0.28, 0.42, 0.62, 0.78, 0.81, 0.83], [215.0, 190.0, 165.0, 220.0, 190.0, 90.0])


@lru_cache(maxsize=1)
def extinguisher() -> Picture:
    """Draw a red cylinder with a black valve, a hose and a pale label."""
    wide, high = EXTINGUISHER_MM
    columns, rows = round(wide / _TEXEL_MM), round(high / _TEXEL_MM)
    x, y = np.meshgrid(
        (np.arange(columns) + 0.5) * _TEXEL_MM - wide / 2, (rows - 0.5 - np.arange(rows)) * _TEXEL_MM
    )
    roundness = np.sqrt(np.clip(1.0 - (x / 75.0) ** 2, 0.0, 1.0))
    body = (np.abs(x) < 75.0) & (y < 400.0 + 55.0 * roundness)
    shades = np.where(np.abs(x + 25.0) < 12.0, _SHADES[1] + 0.15, _SHADES[0] * (0.45 + 0.55 * roundness))
    shades = np.where((np.abs(x) < 55.0) & (y > 150.0) & (y < 270.0), 0.75 * roundness, shades)
    valve = (np.abs(x) < 28.0) & (y >= 440.0) & (y < 530.0) | (np.abs(x) < 70.0) & (np.abs(y - 525.0) < 14.0)
    hose = (np.abs(x - 84.0) < 9.0) & (y > 120.0) & (y < 500.0) | (x > 20.0) & (np.abs(y - 495.0) < 9.0)
    dark = valve | hose
    return Picture(
        shades=np.where(dark, 0.07, shades), opacity=(body | dark).astype(np.float64),
        width_mm=wide, height_mm=high,
    )  # fmt: skip
