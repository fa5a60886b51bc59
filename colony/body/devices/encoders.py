"""Encoders of wheels."""

from __future__ import annotations

from dataclasses import dataclass

from colony.body.devices.common import MAX_WHEELS, SPREAD, Sensor
from colony.body.kinds import Whole, entry
from colony.ir.servers import FieldSpec
from colony.ir.types import DISTANCE, Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Encoders(Sensor):
    """Encoders of the driven wheels, which dead reckoning is made of."""

    wheels: int = entry("wheels", Whole(2, MAX_WHEELS), "the number of driven wheels [default: 2]", default=2)
    resolution_mm: float = entry(
        "resolution",
        SPREAD,
        "how far a wheel rolls from tick to tick [default: no ticks]",
        default=0.0,
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        travel = "the distance that each wheel has rolled, negative backward"
        return (FieldSpec("travel", Array(DISTANCE, self.wheels), travel),)
