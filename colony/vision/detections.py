"""Detections in the image of a level camera."""

from __future__ import annotations

from typing import NamedTuple

# --- periods -------------------------------------------------------------------------------------------
#
# The periods of the scripts that process images.


PERIOD_S = 0.25
"""Seconds between two images."""


# --- detections ----------------------------------------------------------------------------------------


Corner = tuple[float, float]
"""A position in an image: column and row, in pixels."""


class PlateReading(NamedTuple):
    """The reading of a plate.

    `text` is "" if the plate is illegible; `confidence` is from 0 to 1. `alternatives` are the next most
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
    def center(self) -> Corner:
        """The mean of the corners."""
        columns, rows = zip(*self.corners, strict=True)
        return sum(columns) / 4.0, sum(rows) / 4.0

    def shifted_down(self, rows: float) -> PlateBox:
        """Return the box shifted down by `rows` rows, as when rows are added above a band."""
        first, second, third, fourth = ((column, row + rows) for column, row in self.corners)
        return PlateBox((first, second, third, fourth), self.score)


class MarkerBox(NamedTuple):
    """A marker in an image.

    Attributes:
        left, right: columns of its outer edges.
        first_row, last_row: first and last row in which it was found.
        code: its three bits, the leftmost first.
        edges: columns of the edges of all its stripes, from left to right.
    """

    left: float
    right: float
    first_row: int
    last_row: int
    code: int
    edges: tuple[float, ...] = ()
