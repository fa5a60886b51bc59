"""Sensors that look down."""

from __future__ import annotations

import math
from dataclasses import dataclass

from colony.body.devices.common import FIELD_NAME, POSITION, Place, Sensor
from colony.body.kinds import Many, Row, entry
from colony.ir.servers import FieldSpec
from colony.ir.types import BOOL, MAX_ELEMENTS, Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Cliff(Sensor):
    """Sensors that look down, and see where the ground is missing."""

    field: str = entry("field", FIELD_NAME, "the field that has them [default: cliff]", default="cliff")
    places: tuple[Place, ...] = entry(
        "places",
        Many(Row((POSITION, POSITION), Place), 1, MAX_ELEMENTS),
        "where each sensor looks: x ahead of the robot's center, y to the left of it",
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return (FieldSpec(self.field, Array(BOOL, len(self.places)), "true where the ground is missing"),)

    def directions(self) -> tuple[float | None, ...]:
        """Return where each place lies from the robot's center, in degrees; None for one at the center."""
        return tuple(math.degrees(math.atan2(y, x)) if x or y else None for x, y in self.places)
