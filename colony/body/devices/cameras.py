"""Cameras."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from colony.body.devices.common import CENTER, POSE, POSE_MEANING, Pose, Sensor
from colony.body.kinds import POSITIVE, Bounds, Measure, Row, Whole, entry
from colony.ir.servers import FieldSpec
from colony.text.units import ANGLE, LENGTH

_HEIGHT = Measure(LENGTH, "1.2 m", POSITIVE)
_VIEW = Measure(ANGLE, "60 deg", Bounds(low=1.0, high=179.0))


class Size(NamedTuple):
    """The size of an image, in pixels."""

    columns: int
    rows: int


_SIZE = Row((Whole(4, 4000), Whole(4, 4000)), Size)


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera(Sensor):
    """A level camera: its optical axis is parallel to the floor."""

    pose: Pose = entry("pose", POSE, POSE_MEANING, default=CENTER)
    height_mm: float = entry("height", _HEIGHT, "height of the lens above the floor")
    view_deg: float = entry("view", _VIEW, "horizontal angle of view")
    size: Size = entry("size", _SIZE, "columns and rows of the image")

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures: none; images are asked for."""
        return ()


@dataclass(frozen=True, slots=True, kw_only=True)
class CeilingCamera(Sensor):
    """A camera that looks straight up, with the columns of its image along the direction of travel."""

    below_ceiling_mm: float = entry("below_ceiling", _HEIGHT, "distance of the lens from the ceiling")
    along_deg: float = entry("along", _VIEW, "angle of view along the direction of travel")
    across_deg: float = entry("across", _VIEW, "angle of view across it")
    size: Size = entry("size", _SIZE, "columns and rows of the image")

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures: none; images are asked for."""
        return ()
