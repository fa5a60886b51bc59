"""The geometry of the camera that looks up at the ceiling (thesis section 5.6, Table 5.3, Figure 5.15).

A column of its image is a line across the robot, with indices that increase forward; a row is a line along
it, with indices that increase to the right. So the ceiling lights of a corridor move through each row from
its end to its start while the robot drives below them.

The simulator's ceiling is rendered with the same geometry; a test compares the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from colony.body import devices
from colony.body.shipped import shipped_body

LIGHT_LENGTH_MM = 600.0
"""Length of a ceiling light along the corridor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CeilingCameraModel:
    """A camera that looks straight up, `height_mm` below the ceiling.

    Attributes:
        columns, rows: size of the image, in pixels.
        length_deg, across_deg: full angles of view along and across the robot, below 180.
        height_mm: distance from the lens to the ceiling.
        ahead_mm, left_mm: position of the lens relative to the robot's center.

    Positions in the image are in pixels, pixel i extending from i - 0.5 to i + 0.5; offsets on the ceiling
    are in mm ahead and to the left of the robot's center.

    Raises:
        ValueError: a parameter is out of range.
    """

    columns: int
    rows: int
    length_deg: float
    across_deg: float
    height_mm: float
    ahead_mm: float = 0.0
    left_mm: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges of the parameters."""
        if min(self.columns, self.rows) < 4:
            raise ValueError(f"an image of {self.columns} x {self.rows} pixels; expected at least 4 x 4")
        for name in ("length_deg", "across_deg"):
            if not 0.0 < getattr(self, name) < 180.0:
                raise ValueError(f"{name} is {getattr(self, name)!r}; expected an angle in (0, 180)")
        if not 0.0 < self.height_mm < math.inf:
            raise ValueError(f"height_mm is {self.height_mm!r}; expected a finite height above 0")
        if not (math.isfinite(self.ahead_mm) and math.isfinite(self.left_mm)):
            raise ValueError(f"mounted at {self.ahead_mm!r}, {self.left_mm!r}; expected finite offsets in mm")

    @property
    def mm_per_column(self) -> float:
        """Length of the ceiling that a column covers, along the robot."""
        return 2.0 * self.height_mm * math.tan(math.radians(self.length_deg / 2.0)) / self.columns

    @property
    def mm_per_row(self) -> float:
        """Width of the ceiling that a row covers, across the robot."""
        return 2.0 * self.height_mm * math.tan(math.radians(self.across_deg / 2.0)) / self.rows

    @property
    def scan_rows(self) -> tuple[int, int, int]:
        """The three scan lines: at 1/4, 1/2 and 3/4 of the image's height."""
        return self.rows // 4, self.rows // 2, 3 * self.rows // 4

    def ahead_of(self, column: float) -> float:
        """Return the distance ahead of the robot's center that a column sees on the ceiling, in mm."""
        return self.ahead_mm + self.mm_per_column * (column - (self.columns - 1) / 2.0)

    def left_of(self, row: float) -> float:
        """Return the distance to the left of the robot's center that a row sees on the ceiling, in mm."""
        return self.left_mm + self.mm_per_row * ((self.rows - 1) / 2.0 - row)

    def column_of(self, ahead_mm: float) -> float:
        """Return the column that sees the ceiling at a distance ahead; it may be outside the image."""
        return (self.columns - 1) / 2.0 + (ahead_mm - self.ahead_mm) / self.mm_per_column

    def row_of(self, left_mm: float) -> float:
        """Return the row that sees the ceiling at a distance to the left; it may be outside the image."""
        return (self.rows - 1) / 2.0 - (left_mm - self.left_mm) / self.mm_per_row


def ceiling_camera_of(camera: devices.CeilingCameraSpec) -> CeilingCameraModel:
    """Return the geometry of a camera of a robot's body."""
    return CeilingCameraModel(
        columns=camera.size.columns,
        rows=camera.size.rows,
        length_deg=camera.along_deg,
        across_deg=camera.across_deg,
        height_mm=camera.below_ceiling_mm,
    )


UPWARD = ceiling_camera_of(shipped_body("rome").ceiling_camera())
"""The camera of RoME, the thesis's robot: 1.2 m by 1.56 m of the ceiling, in 120 rows of 240 pixels."""
