"""The compass, disturbed by iron in the building (thesis Figure 6.2).

The disturbance is gridded noise: each corner of a grid has a random value, with smooth interpolation in
between, so that the disturbance is bounded and continuous (Perlin 1985).
"""

from __future__ import annotations

import math

from colony.sim.hazards.scenery import CompassDisturbance

_MASK = 2**64 - 1


def disturbance_deg(field: CompassDisturbance, x_mm: float, y_mm: float) -> float:
    """Return the error of a compass at a position, in degrees, at most `field.max_deg`."""
    if field.max_deg == 0.0:
        return 0.0
    column, row = (
        math.floor(x_mm / field.spacing_mm),
        math.floor(y_mm / field.spacing_mm),
    )
    east = _smooth(x_mm / field.spacing_mm - column)
    north = _smooth(y_mm / field.spacing_mm - row)
    south_side = _blend(
        _corner(field.seed, column, row),
        _corner(field.seed, column + 1, row),
        east,
    )
    north_side = _blend(
        _corner(field.seed, column, row + 1),
        _corner(field.seed, column + 1, row + 1),
        east,
    )
    return field.max_deg * _blend(south_side, north_side, north)


def _corner(seed: int, column: int, row: int) -> float:
    """Return the value of a corner of the grid, in [-1, 1); splitmix64, as in `colony.sim.chance`."""
    bits = (seed * 0x9E3779B97F4A7C15 + column * 0xD1B54A32D192ED03 + row * 0x8CB92BA72F3D8DD7) & _MASK
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        bits = ((bits ^ (bits >> shift)) * factor) & _MASK
    return ((bits ^ (bits >> 31)) >> 11) * 2.0**-52 - 1.0


def _smooth(fraction: float) -> float:
    return fraction * fraction * (3.0 - 2.0 * fraction)


def _blend(start: float, end: float, fraction: float) -> float:
    return start + fraction * (end - start)
