"""Faults of devices: times in which readings are missing or frozen.

Faults follow each other without memory: the time from the end of one to the next is exponential, and what
kind it is and how long it lasts are drawn for each. So the faults of a device depend on its seed alone.
"""

from __future__ import annotations

import math
from enum import Enum, auto

import numpy as np

from colony.body.model import Faults
from colony.sim.chance import FAULTS, draw_uniforms


class Fault(Enum):
    """What is wrong with readings: there are none, or no new ones."""

    MISSING = auto()
    FROZEN = auto()


class FaultTimeline:
    """The faults of a device, in order. Stateful: the current or next one, as time goes on.

    Args:
        faults: how often they occur, and how long they last.
        seed: the seed of the device.
    """

    def __init__(self, faults: Faults, seed: int) -> None:
        share = faults.missing + faults.frozen
        self._missing = faults.missing / share
        self._lasting_ns = faults.lasting_s * 1e9
        self._gap_ns = self._lasting_ns * (1.0 - share) / share
        self._seed = seed
        self._numbers = np.empty(3)
        self._count = 0
        self._begin_ns = self._end_ns = 0.0
        self._fault = Fault.MISSING
        self._draw()

    def at(self, elapsed_ns: int) -> Fault | None:
        """Return the fault at a time, which is not before that of the last call; None if there is none."""
        while elapsed_ns >= self._end_ns:
            self._draw()
        return self._fault if elapsed_ns >= self._begin_ns else None

    def _draw(self) -> None:
        """Draw the next fault."""
        draw_uniforms(self._seed, FAULTS, self._count, self._numbers)
        gap, kind, length = self._numbers.tolist()
        self._begin_ns = self._end_ns - math.log1p(-gap) * self._gap_ns
        self._end_ns = self._begin_ns + (0.5 + length) * self._lasting_ns
        self._fault = Fault.MISSING if kind < self._missing else Fault.FROZEN
        self._count += 1


def faults_of(faults: Faults | None, seed: int) -> FaultTimeline | None:
    """Return the faults of a device with this seed; None if it has none."""
    if faults is None or faults.missing + faults.frozen == 0.0:
        return None
    return FaultTimeline(faults, seed)
