"""Data association: the map's plate for an observed plate, by its position and its text."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from colony.nav.maps.signs import Plate
from colony.vision.plates.observations import PlateObservation

MIN_GATE_MM, MAX_GATE_MM = 260.0, 1_200.0
"""Gates for a plate's distance from its position in the map, along the wall.

The first is for an accurate estimate of the robot's position, the second for an uncertain one.
"""

GATE_SIGMAS = 3.0

MAX_FACING_DEG = 60.0
"""Maximum angle between the camera's axis and the normal of an observed plate's wall."""

SURE_CONFIDENCE = 0.9
"""Confidence of a text from which plates with other texts are ruled out."""

_MISREAD_FRACTION = 0.5  # fraction of the gate within which a plate may have been misread


def gate_mm(sigma_mm: float | None) -> float:
    """Return the gate for a plate's distance; `sigma_mm` is that of the robot's position, None if unknown."""
    if sigma_mm is None or not math.isfinite(sigma_mm):
        return (MIN_GATE_MM + MAX_GATE_MM) / 2.0
    return min(max(GATE_SIGMAS * sigma_mm, MIN_GATE_MM), MAX_GATE_MM)


def match_plate(
    place: tuple[float, float],
    observation: PlateObservation,
    text: str,
    confidence: float,
    plates: Sequence[Plate],
    *,
    gate: float,
    taken: Iterable[str] = (),
) -> Plate | None:
    """Return the plate of the map that matches an observed plate, or None without a match.

    Args:
        place: x and y in mm.
        observation: one observation of it, from the robot's estimated pose.
        text: its text, "" if unread.
        confidence: the confidence of the text.
        plates: the plates of the map.
        gate: maximum distance from its position in the map, along the wall, in mm; twice that across the
            wall, as distances are measured less accurately.
        taken: doors of the plates that are matched already.
    """
    taken_doors = set(taken)
    candidates: list[tuple[float, Plate]] = []
    for plate in plates:
        if plate.door in taken_doors or not _is_faced(plate, observation):
            continue
        distance = _distance_mm(plate, place)
        if distance < gate and (
            plate.text == text or confidence < SURE_CONFIDENCE or distance < _MISREAD_FRACTION * gate
        ):
            # A plate with the text that was read is preferred to a nearer one.
            candidates.append((distance - (gate if plate.text == text and text else 0.0), plate))
    return min(candidates, key=lambda match: match[0])[1] if candidates else None


def _is_faced(plate: Plate, observation: PlateObservation) -> bool:
    return abs(math.remainder(observation.axis_deg - plate.heading_deg, 360.0)) < MAX_FACING_DEG


def _distance_mm(plate: Plate, place: tuple[float, float]) -> float:
    """Return the larger of a position's distance from a plate along the wall and half of that across it."""
    facing = math.radians(plate.heading_deg)
    dx, dy = place[0] - plate.center.x, place[1] - plate.center.y
    across, along = (
        -math.sin(facing) * dx + math.cos(facing) * dy,
        math.cos(facing) * dx + math.sin(facing) * dy,
    )
    return max(abs(along), abs(across) / 2.0)
