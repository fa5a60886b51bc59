"""The map's plate that an observed plate is: the nearest one to its place, if that is likely."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from colony.nav.maps.signs import Plate
from colony.vision.plates.sights import Seen

LEAST_GATE_MM, MOST_GATE_MM = 260.0, 1_200.0
"""Gates of a plate's distance from its place in the map, along the wall.

The first is for a robot that is sure of its position, the second for one that is not.
"""

SIGMAS = 3.0

FACING_DEG = 60.0
"""A plate that is seen hangs on a wall that the camera faces, more or less."""

SURE = 0.9
"""Confidence from which on the text decides: another text is another plate."""

_BESIDE = 0.5  # of the gate: a plate that is nearer than this may have been misread


def gate_mm(sigma_mm: float | None) -> float:
    """Return the gate of a plate's distance, for a standard deviation of the robot's position."""
    if sigma_mm is None or not math.isfinite(sigma_mm):
        return (LEAST_GATE_MM + MOST_GATE_MM) / 2.0
    return min(max(SIGMAS * sigma_mm, LEAST_GATE_MM), MOST_GATE_MM)


def known_plate(
    place: tuple[float, float],
    look: Seen,
    text: str,
    confidence: float,
    plates: Sequence[Plate],
    *,
    gate: float,
    taken: Iterable[str] = (),
) -> Plate | None:
    """Return the plate of the map that is at a place, or None if there is none that it can be.

    Args:
        place: x and y in mm.
        look: one look at it, from where the robot believed to be.
        text: its text, as far as it was read.
        confidence: the confidence of the text.
        plates: the plates of the map.
        gate: how far it may be from its place in the map, along the wall, in mm; across it twice as far,
            since distances are measured less well.
        taken: the doors of plates that are known to be others.
    """
    others = set(taken)
    near: list[tuple[float, Plate]] = []
    for plate in plates:
        if plate.door in others or not _is_faced(plate, look):
            continue
        off = _off_mm(plate, place)
        if off < gate and (plate.text == text or confidence < SURE or off < _BESIDE * gate):
            # One whose text was read is taken before a nearer one.
            near.append((off - (gate if plate.text == text and text else 0.0), plate))
    return min(near, key=lambda one: one[0])[1] if near else None


def _is_faced(plate: Plate, look: Seen) -> bool:
    return abs(math.remainder(look.axis_deg - plate.heading_deg, 360.0)) < FACING_DEG


def _off_mm(plate: Plate, place: tuple[float, float]) -> float:
    """Return the distance of a place from a plate: along its wall, or half of that across the wall."""
    facing = math.radians(plate.heading_deg)
    dx, dy = place[0] - plate.middle.x, place[1] - plate.middle.y
    across, along = (
        -math.sin(facing) * dx + math.cos(facing) * dy,
        math.cos(facing) * dx + math.sin(facing) * dy,
    )
    return max(abs(along), abs(across) / 2.0)
