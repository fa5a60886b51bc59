"""Compasses."""

from __future__ import annotations

from dataclasses import dataclass

from colony.body.devices.common import Sensor
from colony.body.kinds import NOT_NEGATIVE, Bounds, Measure, entry
from colony.ir.servers import FieldSpec
from colony.ir.types import DEGREES
from colony.text.units import ANGLE


@dataclass(frozen=True, slots=True, kw_only=True)
class Compass(Sensor):
    """A compass, which iron in the building disturbs."""

    noise_deg: float = entry(
        "noise", Measure(ANGLE, "1 deg", NOT_NEGATIVE), "standard deviation of a reading", default=0.0
    )
    offset_deg: float = entry(
        "offset",
        Measure(ANGLE, "2 deg", Bounds(low=-360.0, high=360.0)),
        "what is added to each reading, as by a compass that is mounted askew",
        default=0.0,
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return (FieldSpec("heading", DEGREES, "the heading, 0 north, 90 west, in [0, 360)"),)
