"""Equal rings of sonars and infrared detectors of robots of a world, measured once a step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from colony.sim.compiled import Bools2, Floats, Floats2
from colony.sim.config import RingConfig
from colony.sim.sensors.sonar import CrossTalk, fan_of, proximity_model, sense
from colony.sim.world.people import Crowd


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
