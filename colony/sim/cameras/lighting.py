"""The lighting of a building: brighter under ceiling lights, darker where one is out."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from colony.sim.cameras.surfaces import Lighting
from colony.sim.compiled import Floats
from colony.sim.hazards.scenery import CeilingLight

_CELL_MM = 500.0
_AMBIENT, _LIGHT_GAIN, _REACH_MM, _MAX_LEVEL = 0.90, 0.45, 2500.0, 1.50
_WINDOW_MM = 3.0 * _REACH_MM


def lighting_of(bounds: tuple[float, float, float, float], lights: Iterable[CeilingLight]) -> Lighting:
    """Return the light levels within bounds (minimum x and y, maximum x and y, in mm)."""
    x0, y0, x1, y1 = bounds
    columns, rows = (max(math.ceil(size / _CELL_MM) + 1, 1) for size in (x1 - x0, y1 - y0))
    levels = np.full((columns, rows), _AMBIENT)
    x, y = (np.arange(count, dtype=np.float64) for count in (columns, rows))
    x, y = x * _CELL_MM + x0, y * _CELL_MM + y0
    for light in lights:
        across = _window(x, light.x_mm)
        along = _window(y, light.y_mm)
        dx, dy = x[across] - light.x_mm, y[along] - light.y_mm
        squared = dx[:, None] ** 2 + dy[None, :] ** 2
        levels[across, along] += light.brightness * _LIGHT_GAIN * np.exp(-squared / _REACH_MM**2)
    return Lighting(levels=np.minimum(levels, _MAX_LEVEL), x=x0, y=y0, cell=_CELL_MM)


def _window(coordinates: Floats, center: float) -> slice:
    """Return the range of the coordinates that a light at `center` brightens."""
    first, last = np.searchsorted(coordinates, (center - _WINDOW_MM, center + _WINDOW_MM)).tolist()
    return slice(first, last)
