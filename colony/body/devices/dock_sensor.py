"""Sensors of charging docks."""

from __future__ import annotations

import math
from dataclasses import dataclass

from colony.body.devices.common import CENTER, POSE, POSE_MEANING, RANGE, SPREAD, Pose, Sensor
from colony.body.kinds import NOT_NEGATIVE, Bounds, Measure, entry
from colony.ir.servers import FieldSpec
from colony.ir.types import BOOL, DISTANCE, Quantity
from colony.text.units import ANGLE


@dataclass(frozen=True, slots=True, kw_only=True)
class DockSensor(Sensor):
    """A sensor that sees the nearest dock of the map, if no wall hides it."""

    pose: Pose = entry("pose", POSE, POSE_MEANING, default=CENTER)
    range_mm: float = entry("range", RANGE, "the distance up to which it sees a dock")
    view_deg: float = entry(
        "view",
        Measure(ANGLE, "60 deg", Bounds(low=1.0, high=360.0)),
        "angle of view [default: all around]",
        default=360.0,
    )
    noise_mm: float = entry("noise", SPREAD, "standard deviation of the distance", default=0.0)
    bearing_noise_deg: float = entry(
        "bearing_noise",
        Measure(ANGLE, "1 deg", NOT_NEGATIVE),
        "standard deviation of the bearing",
        default=0.0,
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return (
            FieldSpec("dock_seen", BOOL, "true while it sees a dock"),
            FieldSpec(
                "dock_distance", DISTANCE, "the distance from the robot's center to the dock that it sees"
            ),
            FieldSpec(
                "dock_bearing", Quantity(ANGLE), "the bearing of that dock, counterclockwise from ahead"
            ),
        )

    @property
    def farthest_mm(self) -> float:
        """The largest distance that it reads."""
        return self.range_mm + math.hypot(self.pose.x_mm, self.pose.y_mm)
