"""PlFinder as printed, without a map (thesis section 5.7).

It reports a plate at its first observation, and distinguishes images by their overlap on the wall only. The
distance of the wall comes from the sonar that faces it.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from contextlib import suppress
from typing import Any

from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.echoes import rome_sonars
from colony.nav.shared import try_ask
from colony.runtime.kit.script import Script, Step, do
from colony.runtime.library import camera as cameras
from colony.runtime.library import proximity
from colony.runtime.protocol.images import Image
from colony.vision.detections import PlateBox
from colony.vision.gray_images import Gray
from colony.vision.level_camera import SIDE, LevelCamera
from colony.vision.lights.observing import NO_ANSWER_ERRORS
from colony.vision.plates.finder import OnPlate, PlateReader, WallCamera, default_reader, report_plates
from colony.vision.plates.observations import FoundPlate
from colony.vision.plates.search import SearchResult, View, is_too_steep, observe_box
from studies.thesis.light_track import PERIOD_S
from studies.thesis.plate_boxes import scan_band, thesis_plates
from studies.thesis.wall_view import WallView, starting_column


def thesis_plate_finder(
    *,
    camera: str = "CServerSide",
    geometry: LevelCamera = SIDE,
    reader: PlateReader | None = default_reader,
    on_plate: OnPlate | None = None,
) -> Script:
    """Find the plates that the robot passes, forever; the arguments are those of `plate_finder`."""
    search = ThesisSearch(geometry, reader)

    def look(view: View) -> Generator[Step, Any, SearchResult]:
        if view.band is None:
            return SearchResult()
        return search.update(view, (yield from _wall_distance_mm(geometry)))

    return report_plates(_LockedCamera(camera, geometry, scan_band(geometry), PERIOD_S), look, on_plate)


def _wall_distance_mm(geometry: LevelCamera) -> Generator[Step, Any, float | None]:
    """Return the distance from the robot's center to the wall, or None without a reading."""
    scan = yield from try_ask("PServer", proximity.sonar())
    if scan is None:
        return None
    sonars = rome_sonars()
    facing = (sonars.ahead + round(geometry.yaw_deg * sonars.count / 360.0)) % sonars.count
    return sonars.ring_mm + scan.ranges[facing]


class _LockedCamera(WallCamera):
    """A camera that is locked for each image, as printed. Mutable."""

    def grab(self) -> Generator[Step, Any, Image | None]:
        """Return the rows of the newest image; None if the camera is not available."""
        try:
            yield from do(self._name, cameras.lock(wait_s=0.1))
        except NO_ANSWER_ERRORS:
            return None
        band = yield from super().grab()
        with suppress(*NO_ANSWER_ERRORS):
            yield from do(self._name, cameras.unlock())
        return band


class ThesisSearch:
    """The search as printed: a plate on a part of the wall that the last image did not show is a new one.

    The last image is the last one with a plate. Mutable.
    """

    def __init__(self, camera: LevelCamera, reader: PlateReader | None = None) -> None:
        self._camera = camera
        self._reader = reader
        self._last: tuple[WallView, Pose] | None = None

    def update(self, view: View, distance_mm: float | None) -> SearchResult:
        """Return the new plates in a view of a wall at this distance; None without a reading."""
        if view.band is None or view.tilt_deg is None or is_too_steep(view.tilt_deg):
            return SearchResult()
        if distance_mm is None or not 0.0 < distance_mm < math.inf:
            return SearchResult()
        wall = WallView(distance_mm, view.tilt_deg)
        start = self._start(wall, view.robot)
        boxes = thesis_plates(view.band, self._camera, first_row=view.first_row, starting_column=start)
        if boxes:
            self._last = wall, view.robot
        return SearchResult(tuple(self._report(view, view.band, box) for box in boxes))

    def _start(self, wall: WallView, here: Pose) -> int:
        """Return the first column that shows wall outside the last image with a plate."""
        if self._last is None:
            return 0
        before, there = self._last
        moved = math.hypot(here.x_mm - there.x_mm, here.y_mm - there.y_mm)
        return starting_column(before, wall, moved, self._camera)

    def _report(self, view: View, band: Gray, box: PlateBox) -> FoundPlate:
        seen = observe_box(band, box, view, self._camera, self._reader)
        return FoundPlate(
            t_ns=view.t_ns, door=None, text=seen.reading.text, confidence=seen.reading.confidence,
            place=seen.place, robot=view.robot, images=1,
        )  # fmt: skip
