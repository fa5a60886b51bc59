"""The effects of a lens and a sensor on a picture: blur, vignetting, gain and noise.

Noise is counter-based: it depends on the seed, the time of the image and the pixel, so that a band of rows
rendered alone is the same as in the whole image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from colony.sim.cameras.grain import QUANTILES, quantiles
from colony.sim.chance import PIXELS, SEED_MODULUS, random_bits, uniform
from colony.sim.compiled import Bytes2, Floats, Floats2, inlined

GAINS = PIXELS + 1
"""The random stream of the gain; the other streams are in `colony.sim.chance`."""

_GAIN_MM = 4000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Optics:
    """A lens and a sensor.

    Attributes:
        rays: number of rays per column, spread over its width and over the exposure.
        blur: standard deviation of the lens's blur, as a fraction of the image's width.
        vignetting: fraction by which the corners are darker.
        exposure_s: exposure time, which causes motion blur.
        gain: maximum relative error of the camera's gain, which varies with the robot's position.
        noise: standard deviation of a pixel, in gray levels.

    Raises:
        ValueError: a number is out of range.
    """

    rays: int = 4
    blur: float = 0.5 / 240.0
    vignetting: float = 0.22
    exposure_s: float = 0.016
    gain: float = 0.2
    noise: float = 2.5

    def __post_init__(self) -> None:
        """Check the ranges of the parameters."""
        highest = {"rays": 16.0, "blur": 0.02, "vignetting": 1.0, "exposure_s": 1.0, "gain": 0.9}
        for each in fields(self):
            value, low, high = getattr(self, each.name), float(each.name == "rays"), highest.get(each.name)
            if not low <= value <= (255.0 if high is None else high):
                raise ValueError(f"{each.name} is {value!r}; expected {low:g} to {high or 255.0:g}")


PINHOLE = Optics(rays=1, blur=0.0, vignetting=0.0, exposure_s=0.0, gain=0.0, noise=0.0)
"""A camera without errors: one ray through the center of each column."""


class RendererOptics(NamedTuple):
    """Optics in the renderer's form.

    It has the weights of the blur from its center outward, and quantiles of the normal distribution.
    """

    weights: Floats
    quantiles: Floats
    vignetting: float
    gain: float
    noise: float
    seed: int


def sensor_of(optics: Optics, *, width: int, seed: int) -> RendererOptics:
    """Return optics for an image `width` pixels wide."""
    sigma = optics.blur * width
    steps = np.arange(math.ceil(2.5 * sigma) + 1)
    weights = np.exp(-0.5 * (steps / sigma) ** 2) if sigma > 0.0 else np.ones(1)
    return RendererOptics(
        weights=weights / (2.0 * weights.sum() - weights[0]),
        quantiles=quantiles(),
        vignetting=float(optics.vignetting),
        gain=float(optics.gain),
        noise=float(optics.noise),
        seed=seed % SEED_MODULUS,
    )


@inlined
def gain_at(x: float, y: float, sensor: RendererOptics) -> float:
    """Return the camera's gain at a position: smooth noise around 1."""
    east, north = math.floor(x / _GAIN_MM), math.floor(y / _GAIN_MM)
    across, along = x / _GAIN_MM - east, y / _GAIN_MM - north
    across, along = across * across * (3.0 - 2.0 * across), along * along * (3.0 - 2.0 * along)
    noise = 0.0
    for column in range(2):
        for row in range(2):
            weight = (across if column else 1.0 - across) * (along if row else 1.0 - along)
            cell = (int(east) + column + 500_000) * 1_000_000 + int(north) + row + 500_000
            noise += weight * (2.0 * uniform(sensor.seed, GAINS, cell, 0) - 1.0)
    return 1.0 + sensor.gain * noise


@inlined
def blur_columns(picture: Floats2, blurred: Floats2, sensor: RendererOptics) -> None:
    """Blur along the rows of the image, which are the columns of `picture`, (columns, rows).

    Columns within the radius of the blur at either end are not set.
    """
    radius = sensor.weights.shape[0] - 1
    for column in range(radius, picture.shape[0] - radius):
        for row in range(picture.shape[1]):
            blurred[column, row] = sensor.weights[0] * picture[column, row]
        for step in range(1, radius + 1):
            weight = sensor.weights[step]
            for row in range(picture.shape[1]):
                blurred[column, row] += weight * (picture[column - step, row] + picture[column + step, row])


@inlined
def expose(
    picture: Floats2, t_ns: int, first: int, height: int, gain: float, sensor: RendererOptics, image: Bytes2
) -> None:
    """Convert a picture, (columns, rows), with a margin of the blur's radius on all sides, to an image.

    Args:
        picture: the picture, in gray levels.
        t_ns: time of the image, for the noise.
        first: index of the first row in the whole image.
        height: number of rows of the whole image.
        gain: factor of the gray levels.
        sensor: the sensor.
        image: (rows, width), receives the rows.
    """
    radius = sensor.weights.shape[0] - 1
    center_column, center_row = (image.shape[1] - 1) / 2.0, (height - 1) / 2.0
    for row in range(image.shape[0]):
        down = (first + row - center_row) / (center_row + 0.5)
        bits = np.uint64(0)
        for column in range(image.shape[1]):
            level = sensor.weights[0] * picture[column + radius, row + radius]
            for step in range(1, radius + 1):
                above, below = row + radius - step, row + radius + step
                level += sensor.weights[step] * (
                    picture[column + radius, above] + picture[column + radius, below]
                )
            right = (column - center_column) / (center_column + 0.5)
            level *= gain * (1.0 - sensor.vignetting * (right * right + down * down) / 2.0)
            if sensor.noise > 0.0:
                if column % 4 == 0:  # sixteen bits for each of four pixels
                    bits = random_bits(sensor.seed, PIXELS, t_ns, (first + row) * 8192 + column)
                level += sensor.noise * sensor.quantiles[int(bits & np.uint64(QUANTILES - 1))] + 0.5
                bits >>= np.uint64(16)
            image[row, column] = np.uint8(min(max(level, 0.0), 255.0))
