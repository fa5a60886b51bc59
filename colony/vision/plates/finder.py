"""PlFinder: finds the door plates that the robot passes (thesis section 5.7).

It observes the wall on the robot's left through a camera, four times a second, while the robot heads along
the hallway within 50 degrees. Each plate is reported once, when enough observations agree (`search.py`): at
DServer in PlateSeen, and to the callback `on_plate`.

With maps of the floors, only plates on the map of the current floor (`Floor`) are accepted. Each observation
of such a plate measures the robot's pose: PlateFix.

The finder waits while a server does not answer or has no value. While DServer does not answer, the last known
floor counts, and plates are published later. On a floor without a map, nothing is found.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.signs import Plate
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.pose import fix_list, pose_of
from colony.nav.pose.tracker import position_at
from colony.nav.shared import FLOOR, GOAL_DIRECTION, PLATE_FIX, PLATE_SEEN, POSE
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import camera as cameras
from colony.runtime.library import data, robot
from colony.runtime.library.ask import CallRequest
from colony.runtime.library.robot import Position
from colony.runtime.protocol.images import Image
from colony.vision.detections import PERIOD_S, PlateBox, PlateReading
from colony.vision.gray_images import gray_image
from colony.vision.level_camera import SIDE, LevelCamera, prepare_camera
from colony.vision.lights.observing import NO_ANSWER_ERRORS
from colony.vision.plates.observations import FoundPlate, gate_mm
from colony.vision.plates.search import FloorPlates, PlateSearch, SearchResult, View, is_too_steep

BAND_FRACTION = 0.54
"""Fraction of the image's rows, around the middle, that is searched; it holds whole plates from 0.45 m on."""

OLDEST_IMAGE_S = 1.0
"""Maximum age of an image; the robot's pose at older images is not known well enough."""

MAX_UNPUBLISHED = 16
"""Maximum number of plates that are kept for DServer while it does not answer; the oldest are dropped."""

OnPlate = Callable[[FoundPlate], None]
"""Callback with each plate that is found."""

PlateReader = Callable[[NDArray[np.uint8], PlateBox], PlateReading]
"""Reads the text on a plate in an image."""

Look = Callable[[View], Generator[Step, Any, SearchResult]]
"""Step of a script that searches a view for plates."""

T = TypeVar("T")


def default_reader(image: NDArray[np.uint8], box: PlateBox) -> PlateReading:
    """Read a plate with Colony's own reader."""
    from colony.vision.plates.reader import read_plate

    return read_plate(image, box)


def plate_finder(
    floors: Mapping[str, Sequence[Plate]] | None = None,
    *,
    camera: str = "CServerSide",
    geometry: LevelCamera = SIDE,
    reader: PlateReader | None = default_reader,
    on_plate: OnPlate | None = None,
) -> Script:
    """Find the plates that the robot passes, forever.

    Args:
        floors: the plates of each floor, by the name of its map; None without maps.
        camera: the server of the camera.
        geometry: the geometry of the camera.
        reader: the reader of plates' texts; None to leave plates unread.
        on_plate: callback with each plate.

    Raises:
        ValueError: in the script, if the size of the camera's images is not that of `geometry`.
    """
    search = PlateSearch(geometry, reader)
    maps = None if floors is None else _Maps(floors)

    def look(view: View) -> Generator[Step, Any, SearchResult]:
        if maps is None:
            return search.update(view)
        floor_plates = yield from maps.floor_plates()
        return search.update(view._replace(floor=maps.floor), floor_plates)

    count = min(geometry.rows, 2 * math.ceil(BAND_FRACTION * geometry.rows / 2.0))
    band = ((geometry.rows - count) // 2, count)
    return report_plates(WallCamera(camera, geometry, band, PERIOD_S), look, on_plate)


def report_plates(wall: WallCamera, look: Look, on_plate: OnPlate | None = None) -> Script:
    """Report the plates that `look` finds in the views of a camera, forever."""
    yield from wall.prepare()
    count, unpublished = 0, deque[list[object]](maxlen=MAX_UNPUBLISHED)
    while True:
        yield from _publish_plates(unpublished)
        yield from sleep(wall.period_s)
        view = yield from wall.view()
        if view is None:
            continue
        found = yield from look(view)
        for plate in found.plates:
            count += 1
            unpublished.append([plate.t_ns, count, plate.text, *plate.place])
            if on_plate is not None:
                on_plate(plate)
        for fix in found.fixes:
            yield from _try_ask("DServer", data.set(PLATE_FIX, fix_list(fix)))


def _publish_plates(unpublished: deque[list[object]]) -> Generator[Step, Any, None]:
    """Publish plates at DServer, the oldest one first, until it does not answer."""
    while unpublished:
        try:
            yield from do("DServer", data.set(PLATE_SEEN, unpublished[0]))
        except NO_ANSWER_ERRORS:
            return
        unpublished.popleft()


class _Maps:
    """The plates of all floors; `floor` is the robot's last known floor, initially the first one. Mutable."""

    def __init__(self, floors: Mapping[str, Sequence[Plate]]) -> None:
        self._floors = floors
        self.floor = next(iter(floors), "")

    def floor_plates(self) -> Generator[Step, Any, FloorPlates]:
        """Return the plates of the current floor; none without a map of it."""
        floor = yield from _try_ask("DServer", data.get(FLOOR))
        if isinstance(floor, str):
            self.floor = floor
        pose = pose_of((yield from _try_ask("DServer", data.get(POSE))))
        sigma = None if pose is None else math.sqrt(max(pose.xx + pose.yy, 0.0))
        return FloorPlates(self._floors.get(self.floor, ()), gate_mm(sigma))


class WallCamera:
    """The camera that faces the wall. Mutable.

    Args:
        name: the camera's server.
        geometry: the geometry of the camera.
        band: the first of the rows to grab, and their number.
        period_s: seconds between two images.
    """

    def __init__(self, name: str, geometry: LevelCamera, band: tuple[int, int], period_s: float) -> None:
        self._name, self._geometry, self._band = name, geometry, band
        self.period_s = period_s
        self._ready = False
        self._last: Position | None = None
        self._newest_ns = -1

    def prepare(self) -> Generator[Step, Any, None]:
        """Prepare the camera, if it answers."""
        self._ready = yield from prepare_camera(self._name, self._geometry, self.period_s)

    def view(self) -> Generator[Step, Any, View | None]:
        """Return the current view, or None without a new image."""
        here = yield from _try_ask("RServer", robot.position())
        if here is None:
            return None
        last, self._last = self._last, here
        goal = yield from _try_ask("DServer", data.get(GOAL_DIRECTION))
        tilt = _tilt(here.heading, goal)
        if tilt is not None and is_too_steep(tilt):
            return View(here.t_ns, None, 0, _pose(here), tilt)
        if not self._ready:
            yield from self.prepare()
        band = (yield from self.grab()) if self._ready else None
        if band is None or band.t_ns == self._newest_ns or here.t_ns - band.t_ns > OLDEST_IMAGE_S * 1e9:
            return None
        self._newest_ns = band.t_ns
        then = position_at(band.t_ns, here, last)
        gray = gray_image(cameras.array(band))
        return View(band.t_ns, gray, band.first_row, _pose(then), _tilt(then.heading, goal))

    def grab(self) -> Generator[Step, Any, Image | None]:
        """Return the rows of the newest image, in one answer."""
        band = yield from _try_ask(self._name, cameras.grab_rows(*self._band))
        self._ready = band is not None and band.t_ns != self._newest_ns
        return band


def _tilt(heading_deg: float, goal: object) -> float | None:
    """Return the angle of a heading from the direction of the goal, counterclockwise."""
    if not isinstance(goal, int | float) or not math.isfinite(goal):
        return None
    return math.remainder(heading_deg - goal, 360.0)


def _pose(position: Position) -> Pose:
    return Pose(position.x, position.y, position.heading)


def _try_ask(server: str, ask: CallRequest[T]) -> Generator[Step, Any, T | None]:
    """Return a server's answer, or None if it does not answer."""
    try:
        return (yield from do(server, ask))
    except NO_ANSWER_ERRORS:
        return None
