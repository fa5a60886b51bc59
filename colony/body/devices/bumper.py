"""Bumpers by sectors of the hull."""

from __future__ import annotations

from dataclasses import dataclass

from colony.body.devices.common import FIELD_NAME, Sensor
from colony.body.kinds import Interval, Many, entry
from colony.ir.servers import FieldSpec
from colony.ir.types import BOOL, MAX_ELEMENTS, Array
from colony.text.units import ANGLE


@dataclass(frozen=True, slots=True, kw_only=True)
class Bumper(Sensor):
    """A bumper that feels in which sectors of the hull something touches the robot."""

    field: str = entry("field", FIELD_NAME, "the field that has them [default: bumper]", default="bumper")
    sectors: tuple[tuple[float, float], ...] = entry(
        "sectors",
        Many(Interval(ANGLE, "-60 deg .. -20 deg"), 1, MAX_ELEMENTS),
        "the bearings of each sector, counterclockwise from the first to the second",
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return (
            FieldSpec(
                self.field, Array(BOOL, len(self.sectors)), "true for each sector that something touches"
            ),
        )
