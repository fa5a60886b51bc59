"""A module in Python for drawn programs: it gives every kind of answer, valid and invalid."""

from __future__ import annotations

import math
from collections.abc import Mapping


class ErraticModule:
    """Gives valid commands `drive(velocity, turn)`, none, and several kinds of invalid ones, in turn.

    Deterministic: the answer depends on `seed`, on the number of calls, and on the readings. `seed` is a
    number; velocities are in mm/s, turns in deg/s.
    """

    def __init__(self, seed: float) -> None:
        self._calls = int(seed)

    def step(self, frame: Mapping[str, object]) -> object:
        """Return an answer, right or wrong, or raise."""
        self._calls += 1
        size = float(len([value for value in frame.values() if value is True]))
        moment = getattr(frame, "t", math.nan)
        match self._calls % 8:
            case 0:
                return None
            case 1:
                return {"velocity": 10.0 * size, "turn": 1e3 * moment}
            case 2:
                return {"turn": self._calls, "velocity": 7}
            case 3:
                raise RuntimeError("a deliberate failure")
            case 4:
                return {"velocity": True, "turn": 0.0}
            case 5:
                return {"velocity": 1.0}
            case 6:
                return {"velocity": math.inf, "turn": 0.0}
            case _:
                return {"velocity": -5.0 - moment, "turn": -0.0}
