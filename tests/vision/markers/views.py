"""Pictures of markers, drawn pixel by pixel from the pinhole camera's equations: nothing of the simulator."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.signs import MARKER_BITS, MARKER_WIDTH_MM, STRIPE_HEIGHT_MM, STRIPE_MM
from colony.vision.level_camera import AHEAD, LevelCamera

_FINE = 4  # rays a pixel in each direction


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """How a camera stands before a marker, and what else makes up the picture.

    Attributes:
        right_mm, ahead_mm: where the marker's middle is from the lens.
        facing_deg: how far the camera would turn to the left to face the marker squarely.
        black, white, door: gray levels.
        blur_px, noise: the standard deviations of the lens's blur and of each pixel's noise.
        gap_mm: how far the doors are apart, whose middle is the marker's; `cabin` is what is seen between.
        hidden: the part of the marker, from its left, that a person hides.
        raised_mm: by how much the marker hangs higher than the lens.
    """

    code: int
    right_mm: float = 0.0
    ahead_mm: float = 1_100.0
    facing_deg: float = 0.0
    black: float = 25.0
    white: float = 225.0
    door: float = 140.0
    blur_px: float = 0.6
    noise: float = 2.0
    gap_mm: float = 0.0
    cabin: float = 60.0
    hidden: float = 0.0
    raised_mm: float = 0.0


def picture(view: View, *, seed: int = 0, camera: LevelCamera = AHEAD) -> NDArray[np.uint8]:
    """What the camera sees: (rows, columns) of uint8."""
    columns = (np.arange(camera.columns * _FINE) + 0.5) / _FINE - 0.5
    rays = (columns - (camera.columns - 1) / 2.0) / camera.focal
    psi = math.radians(view.facing_deg)
    # The ray r * depth = right + t * cos(psi), depth = ahead + t * sin(psi), of the place t along the doors.
    along = (rays * view.ahead_mm - view.right_mm) / (math.cos(psi) - rays * math.sin(psi))
    depth = view.ahead_mm + along * math.sin(psi)
    rows = (np.arange(camera.rows * _FINE) + 0.5) / _FINE - 0.5
    above = -(rows[:, None] - (camera.rows - 1) / 2.0) / camera.focal * depth[None, :]
    stripes = _stripes(view, along)
    on_marker = (np.abs(above - view.raised_mm) <= STRIPE_HEIGHT_MM / 2.0) & ~np.isnan(stripes)[None, :]
    between = np.abs(along) < view.gap_mm / 2.0
    fine = np.where(
        on_marker, np.nan_to_num(stripes)[None, :], np.where(between, view.cabin, view.door)[None, :]
    )
    fine[:, (along < (view.hidden - 0.5) * MARKER_WIDTH_MM) & (view.hidden > 0.0)] = 90.0
    shape = (camera.rows, _FINE, camera.columns, _FINE)
    levels = _blurred(fine.reshape(shape).mean(axis=(1, 3)), view.blur_px)
    noisy = levels + np.random.default_rng(seed).normal(0.0, 1.0, levels.shape) * view.noise
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _stripes(view: View, along: NDArray[np.float64]) -> NDArray[np.float64]:
    """The gray level of the marker at places along the doors; NaN where it is not."""
    pasted = along - np.sign(along) * view.gap_mm / 2.0  # each half goes with its leaf
    number = np.floor((pasted + MARKER_WIDTH_MM / 2.0) / STRIPE_MM).astype(int)
    bits = [bool(view.code >> (MARKER_BITS - 1 - bit) & 1) for bit in range(MARKER_BITS)]
    white = np.array([number_ % 2 == 1 and not bits[number_ // 2] for number_ in range(2 * MARKER_BITS + 1)])
    there = (number >= 0) & (number < len(white)) & (np.abs(along) >= view.gap_mm / 2.0)
    shade = np.where(white[np.clip(number, 0, len(white) - 1)], view.white, view.black)
    return np.where(there, shade, np.nan)


def _blurred(levels: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    reach = max(1, math.ceil(3.0 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(sigma, 1e-6)) ** 2)
    kernel /= kernel.sum()
    padded = np.pad(levels, reach, mode="edge")
    rowwise = sum(k * padded[:, i : i + levels.shape[1]] for i, k in enumerate(kernel))
    blurred: NDArray[np.float64] = sum(k * rowwise[i : i + levels.shape[0]] for i, k in enumerate(kernel))
    return blurred
