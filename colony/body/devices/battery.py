"""Batteries."""

from __future__ import annotations

from dataclasses import dataclass

from colony.body.devices.common import FRACTION, POWER, SPREAD, Sensor
from colony.body.kinds import POSITIVE, Bounds, Measure, entry
from colony.ir.servers import FieldSpec
from colony.ir.types import BOOL, DIMENSIONLESS
from colony.text.units import ANGLE, TIME
from colony.text.units import POWER as POWER_UNITS


@dataclass(frozen=True, slots=True, kw_only=True)
class Battery(Sensor):
    """A battery, which is charged at a dock of the map or, if the map has none, where the run began."""

    capacity_j: float = entry(
        "capacity", Measure(POWER_UNITS.times(TIME), "500 Wh", POSITIVE), "energy of the full battery"
    )
    start: float = entry(
        "start", FRACTION, "the part that is left when a run begins [default: all]", default=1.0
    )
    standing_w: float = entry("standing", POWER, "power that the robot always takes")
    driving_w: float = entry(
        "driving", POWER, "power that it takes besides at its highest speed; less if it is slower"
    )
    charger_w: float = entry("charger", POWER, "power of the charger [default: none]", default=0.0)
    reach_mm: float = entry(
        "reach", SPREAD, "distance from the charger up to which it charges [default: 200 mm]", default=200.0
    )
    reach_angle_deg: float = entry(
        "reach_angle",
        Measure(ANGLE, "10 deg", Bounds(low=0.0, high=180.0)),
        "angle between the headings of robot and charger up to which it charges [default: any]",
        default=180.0,
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return (
            FieldSpec("level", DIMENSIONLESS, "the charge that is left, 0 to 1"),
            FieldSpec("charging", BOOL, "true while the charger charges it"),
        )
