"""The geometry of level cameras, which look along the floor (thesis sections 5.4.6 and 5.7).

One looks to the left, like sonar 18, for door plates, and one ahead, for the markers of elevators. Their
optical axes are level. A column of the image is a direction, row indices increase downward, pixels are
square, and pixel i extends from i - 0.5 to i + 0.5. Bearings count counterclockwise from the optical axis, in
degrees.

The simulator's cameras are rendered with the same geometry; a test compares the two.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

from colony.body.devices import CameraSpec
from colony.body.shipped import shipped_body
from colony.runtime.kit.script import Step, do
from colony.runtime.library import camera
from colony.vision.lights.observing import NO_ANSWER_ERRORS, ensure_period


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelCamera:
    """A level camera above the robot's center.

    Attributes:
        columns, rows: size of the image, in pixels.
        view_deg: full horizontal angle of view, below 180.
        yaw_deg: direction of the optical axis, counterclockwise from ahead: 90 is to the left.
        height_mm: height of the lens above the floor.

    Raises:
        ValueError: a parameter is out of range.
    """

    columns: int
    rows: int
    view_deg: float
    yaw_deg: float
    height_mm: float

    def __post_init__(self) -> None:
        """Check the ranges of the parameters."""
        if min(self.columns, self.rows) < 4:
            raise ValueError(f"an image of {self.columns} x {self.rows} pixels; expected at least 4 x 4")
        if not 0.0 < self.view_deg < 180.0:
            raise ValueError(f"view_deg is {self.view_deg!r}; expected an angle in (0, 180)")
        if not (math.isfinite(self.yaw_deg) and 0.0 < self.height_mm < math.inf):
            found = f"yaw_deg {self.yaw_deg!r} and height_mm {self.height_mm!r}"
            raise ValueError(f"{found}; expected a finite angle and a finite height above 0")

    @property
    def focal(self) -> float:
        """The focal length in pixels."""
        return self.columns / 2.0 / math.tan(math.radians(self.view_deg) / 2.0)

    def bearing_of(self, column: float) -> float:
        """Return the direction of a column, counterclockwise from the optical axis, in degrees."""
        return math.degrees(math.atan(((self.columns - 1) / 2.0 - column) / self.focal))

    def column_of(self, bearing_deg: float) -> float:
        """Return the column that looks in a direction; it may be outside the image.

        The bearing is within 90 degrees of the optical axis.
        """
        return (self.columns - 1) / 2.0 - self.focal * math.tan(math.radians(bearing_deg))

    def row_of(self, above_floor_mm: float, depth_mm: float) -> float:
        """Return the row of a height at a depth, which is measured along the optical axis."""
        return (self.rows - 1) / 2.0 - self.focal * (above_floor_mm - self.height_mm) / depth_mm


def level_camera_of(camera: CameraSpec) -> LevelCamera:
    """Return the geometry of a camera of a robot's body."""
    return LevelCamera(
        columns=camera.size.columns,
        rows=camera.size.rows,
        view_deg=camera.view_deg,
        yaw_deg=camera.pose.bearing_deg,
        height_mm=camera.height_mm,
    )


SIDE = level_camera_of(shipped_body("rome").camera("CServerSide"))
"""RoME's camera that looks to the left, for door plates."""

AHEAD = level_camera_of(shipped_body("rome").camera("CServerFront"))
"""RoME's camera that looks ahead, for markers."""


# --- camera setup -------------------------------------------------------------------------------------
#
# Sets up a level camera.


def prepare_camera(name: str, geometry: LevelCamera, period_s: float) -> Generator[Step, Any, bool]:
    """Make a camera take an image at least every `period_s`; return False if it does not answer.

    Call it again if the camera did not answer or had no new image after a period: it may have restarted.

    Raises:
        ValueError: the camera's images do not have the size given by `geometry`.
    """
    yield from ensure_period((name,), period_s)
    try:
        size = yield from do(name, camera.size())
    except NO_ANSWER_ERRORS:
        return False
    if (size.width, size.height) != (geometry.columns, geometry.rows):
        found = f"{name} gives images of {size.width} x {size.height} pixels"
        raise ValueError(
            f"{found}; expected {geometry.columns} x {geometry.rows}: pass the camera's `geometry`"
        )
    return True
