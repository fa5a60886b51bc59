"""The path of a robot for a picture, with a bounded number of places for a run of any length."""

from __future__ import annotations

import math

MAX_PLACES = 10_000
"""Largest number of places; beyond it every second place is dropped."""

SPACING_MM = 10.0
"""Initial distance between two places in mm; it doubles each time places are dropped."""


class DrivenPath:
    """A path with bounded memory. Mutable: its places, of which the last is always the newest."""

    def __init__(self, *, max_places: int = MAX_PLACES) -> None:
        self._most = max_places
        self._spacing_mm = SPACING_MM
        self.places: list[tuple[float, float]] = []

    def add(self, x_mm: float, y_mm: float) -> None:
        """Add the robot's present place, in mm."""
        places = self.places
        if len(places) > 1 and math.dist(places[-2], (x_mm, y_mm)) < self._spacing_mm:
            places.pop()
        places.append((x_mm, y_mm))
        if len(places) > self._most:
            del places[1:-1:2]
            self._spacing_mm *= 2.0
