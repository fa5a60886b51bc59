"""Equal rings of sonars and infrared detectors of robots of a world, measured once a step."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from colony.sim.compiled import Bools2, Floats, Floats2
from colony.sim.config import RingConfig
from colony.sim.hazards.scenery import CompassDisturbance
from colony.sim.sensors.sonar import CrossTalk, fan_of, proximity_model, sense
from colony.sim.world.people import Crowd

# --- compass ------------------------------------------------------------------------------------------
#
# The compass, disturbed by iron in the building (thesis Figure 6.2).
#
# The disturbance is gridded noise: each corner of a grid has a random value, with smooth interpolation in
# between, so that the disturbance is bounded and continuous (Perlin 1985).

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


# --- rings --------------------------------------------------------------------------------------------


class Rings:
    """The equal rings of some robots of a world. Mutable: keeps the readings, valid while `is_measured`.

    The rows of `sonar` and `infrared`, (members, channels), are those of the robots in the order of `robots`.

    Args:
        ring: the ring of each robot.
        robots: the numbers of the robots that have it.
    """

    def __init__(self, ring: RingConfig, robots: Sequence[int]) -> None:
        self._model, self._fan = proximity_model(ring), fan_of(ring)
        self._members = np.array(robots, dtype=np.int64)
        self._unwired = np.setdiff1d(np.arange(ring.channels), ring.infrared_wired)
        self.sonar: NDArray[np.float64] = np.empty((len(robots), ring.channels))
        self.infrared: NDArray[np.bool_] = np.empty((len(robots), ring.channels), dtype=np.bool_)
        self.is_measured = False

    def measure(
        self,
        poses: Floats2,
        radii: Floats,
        walls: Floats2,
        boxes: Floats2,
        reflectors: Bools2,
        crowd: Crowd,
        cross_talk: CrossTalk,
        step: int,
        noise: Floats2,
        noise_column: int,
    ) -> None:
        """Measure with all rings; the arguments are those of `sense`."""
        sense(
            poses,
            radii,
            self._members,
            walls,
            boxes,
            reflectors,
            crowd,
            self._model,
            cross_talk,
            step,
            self._fan,
            noise,
            noise_column,
            self.sonar,
            self.infrared,
        )
        self.infrared[:, self._unwired] = False
        self.is_measured = True
