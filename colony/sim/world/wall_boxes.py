"""Boxes around groups of walls, by which compiled functions pass over walls that are far away.

Walls keep their order, and each group is a run of neighbors in it, as maps and outlines have them. A function
that looks for walls within a distance looks at the boxes first. A box is a little larger than its walls, so
that rounding never hides a wall that is within the distance.
"""

from __future__ import annotations

import numpy as np

from colony.sim.compiled import Floats2, inlined

GROUP = 16
"""Number of walls in a group; the last group may have fewer."""

LOW_X, LOW_Y, HIGH_X, HIGH_Y, IS_OUTLINE = range(5)
"""Columns of the table of boxes: their sides in mm, and 1 for walls that are outlines of solid things."""

_MARGIN_MM = 1.0


def wall_boxes(walls: Floats2, *, outlines: bool = False) -> Floats2:
    """Return the boxes of walls.

    Args:
        walls: (n, 7), from `wall_table`.
        outlines: True if all walls are outlines of solid things, which are on their left: no light reaches
            their left sides.

    Returns:
        (groups, 5), see `LOW_X` to `IS_OUTLINE`.
    """
    starts = np.arange(0, len(walls), GROUP)
    boxes = np.empty((len(starts), 5))
    if len(walls):
        low, high = np.minimum(walls[:, :2], walls[:, 2:4]), np.maximum(walls[:, :2], walls[:, 2:4])
        boxes[:, LOW_X : LOW_Y + 1] = np.minimum.reduceat(low, starts) - _MARGIN_MM
        boxes[:, HIGH_X : HIGH_Y + 1] = np.maximum.reduceat(high, starts) + _MARGIN_MM
        boxes[:, IS_OUTLINE] = float(outlines)
    return boxes


@inlined
def box_gap(boxes: Floats2, group: int, x: float, y: float) -> float:
    """Return the square of the distance from a point to a box; no wall in it is nearer."""
    dx: float = max(boxes[group, LOW_X] - x, x - boxes[group, HIGH_X], 0.0)
    dy: float = max(boxes[group, LOW_Y] - y, y - boxes[group, HIGH_Y], 0.0)
    return dx * dx + dy * dy
