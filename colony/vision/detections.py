"""Detections in the image of a level camera."""

from __future__ import annotations

from typing import NamedTuple

Corner = tuple[float, float]
"""A place in an image: column and row, in pixels."""


class Reading(NamedTuple):
    """The reading of a plate.

    `text` is "" if nothing can be read; `confidence` is from 0 to 1. `alternatives` are the next most
    probable texts with their confidences, best first.
    """

    text: str
    confidence: float
    alternatives: tuple[tuple[str, float], ...] = ()


class PlateBox(NamedTuple):
    """A door plate in an image: its corners clockwise from the upper left one, and its score from 0 to 1."""

    corners: tuple[Corner, Corner, Corner, Corner]
    score: float

    @property
    def middle(self) -> Corner:
        """The mean of the corners."""
        columns, rows = zip(*self.corners, strict=True)
        return sum(columns) / 4.0, sum(rows) / 4.0

    def lowered(self, rows: float) -> PlateBox:
        """Return the box in an image that begins `rows` rows higher up."""
        first, second, third, fourth = ((column, row + rows) for column, row in self.corners)
        return PlateBox((first, second, third, fourth), self.score)


class MarkerBox(NamedTuple):
    """A marker in an image.

    It has its outer edges in columns, the first and last row in which it was found, and its code of three
    bits, the leftmost first. `edges` are those of all its stripes, from left to right.
    """

    left: float
    right: float
    first_row: int
    last_row: int
    code: int
    edges: tuple[float, ...] = ()
