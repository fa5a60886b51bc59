"""The path of a robot for a picture: as many places as a picture can show, however long the run."""

from __future__ import annotations

import math

MOST_PLACES = 10_000
"""Number of places above which every second one is dropped."""

SPACING_MM = 10.0
"""Distance between two places at first; it doubles whenever places are dropped."""


class DrivenPath:
    """A path whose memory is bounded. Mutable: its places, of which the last is always the newest."""

    def __init__(self, *, most: int = MOST_PLACES) -> None:
        self._most = most
        self._spacing_mm = SPACING_MM
        self.places: list[tuple[float, float]] = []

    def add(self, x_mm: float, y_mm: float) -> None:
        """Note where the robot is now."""
        places = self.places
        if len(places) > 1 and math.dist(places[-2], (x_mm, y_mm)) < self._spacing_mm:
            places.pop()
        places.append((x_mm, y_mm))
        if len(places) > self._most:
            del places[1:-1:2]
            self._spacing_mm *= 2.0
