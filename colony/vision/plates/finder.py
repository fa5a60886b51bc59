"""PlFinder: finds the door plates that the robot passes (thesis section 5.7).

It looks through a camera at the wall on the robot's left, four times a second, while the robot heads along
the hallway, give or take 50 degrees. Each plate is reported once, when enough looks agree upon it
(`search.py`): at DServer in PlateSeen, and to the callback `on_plate`.

With the maps of the floors, of which Floor names the present one, what hangs where the map has no plate is
none, and each look at a known plate gives the robot's place: PlateFix. The thesis's own finder
(`thesis=True`) reports a plate at its first look, and distinguishes images by their overlap on the wall only.

While a server is away, or has nothing to say, the finder waits; while DServer is away, the floor is the last
known one, and plates are published later. On a floor that is none of the maps nothing is found.
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
from colony.nav.pose.echoes import SonarModel
from colony.nav.pose.fixes import fix_list
from colony.nav.pose.pose import pose_of
from colony.nav.pose.tracker import position_at
from colony.nav.shared import FLOOR, GOAL_DIRECTION, PLATE_FIX, PLATE_SEEN, POSE
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import camera as cameras
from colony.runtime.library import data, proximity, robot
from colony.runtime.library.ask import Ask
from colony.runtime.library.robot import Position
from colony.runtime.protocol.images import Image
from colony.vision.gray_images import gray_image
from colony.vision.level_camera import SIDE, LevelCamera
from colony.vision.level_looks import made_ready
from colony.vision.lights.looks import SILENT
from colony.vision.periods import PERIOD_S, THESIS_PERIOD_S
from colony.vision.plates.geometry import is_too_steep
from colony.vision.plates.map import gate_mm
from colony.vision.plates.search import Known, PlateSearch, Search, ThesisSearch, View
from colony.vision.plates.sights import PlateSight
from colony.vision.plates.thesis import scan_band
from colony.vision.sightings import PlateBox, Reading

BAND = 0.54
"""The part of the image's rows, about the middle, that ours looks at: all of a plate from 0.45 m on."""

SIDEWARD = 18
"""The sonar whose axis is that of the camera."""

OLDEST_IMAGE_S = 1.0
"""It is not known well enough where older images were taken."""

MOST_UNTOLD = 16
"""Largest number of plates that are kept for a DServer that is away: the newest ones."""

OnPlate = Callable[[PlateSight], None]
"""Callback with each plate that is found."""

PlateReader = Callable[[NDArray[np.uint8], PlateBox], Reading]
"""Reads what is written on a plate in an image."""

T = TypeVar("T")


def read(image: NDArray[np.uint8], box: PlateBox) -> Reading:
    """Read a plate with Colony's own reader."""
    from colony.vision.plates.reader import read_plate

    return read_plate(image, box)


def plate_finder(
    floors: Mapping[str, Sequence[Plate]] | None = None,
    *,
    camera: str = "CServerSide",
    geometry: LevelCamera = SIDE,
    reader: PlateReader | None = read,
    thesis: bool = False,
    on_plate: OnPlate | None = None,
) -> Script:
    """Find the plates that the robot passes, forever.

    Args:
        floors: the plates of each floor, by the name of its map; None: the map is not known.
        camera: the server of the camera.
        geometry: the geometry of the camera.
        reader: reads the text on a plate; None: plates are not read.
        thesis: find as printed, without a map.
        on_plate: called with each plate.

    Raises:
        ValueError: in the script, where the camera's images are not as large as `geometry` says.
    """
    period = THESIS_PERIOD_S if thesis else PERIOD_S
    search: Search = ThesisSearch(geometry, reader) if thesis else PlateSearch(geometry, reader)
    eye = _Eye(camera, geometry, period, lock=thesis)
    maps = None if thesis or floors is None else _Maps(floors)
    return _finder(eye, search, maps, period, on_plate)


def _finder(
    eye: _Eye, search: Search, maps: _Maps | None, period_s: float, on_plate: OnPlate | None
) -> Script:
    yield from eye.prepare()
    count, untold = 0, deque[list[object]](maxlen=MOST_UNTOLD)
    while True:
        yield from _tell_plates(untold)
        yield from sleep(period_s)
        view = yield from eye.look()
        if view is None:
            continue
        known = None if maps is None else (yield from maps.known())
        found = search.look(view if maps is None else view._replace(floor=maps.floor), known)
        for sight in found.told:
            count += 1
            untold.append([sight.t_ns, count, sight.text, *sight.place])
            if on_plate is not None:
                on_plate(sight)
        for fix in found.fixes:
            yield from _answer("DServer", data.set(PLATE_FIX, fix_list(fix)))


def _tell_plates(untold: deque[list[object]]) -> Generator[Step, Any, None]:
    """Publish plates at DServer, the oldest one first, as long as it takes them."""
    while untold:
        try:
            yield from do("DServer", data.set(PLATE_SEEN, untold[0]))
        except SILENT:
            return
        untold.popleft()


class _Maps:
    """The plates of all floors. Mutable: `floor`, the robot's last known floor, at first the first one."""

    def __init__(self, floors: Mapping[str, Sequence[Plate]]) -> None:
        self._floors = floors
        self.floor = next(iter(floors), "")

    def known(self) -> Generator[Step, Any, Known]:
        """Return the plates of the present floor; none if there is no map of it."""
        told = yield from _answer("DServer", data.get(FLOOR))
        if isinstance(told, str):
            self.floor = told
        pose = pose_of((yield from _answer("DServer", data.get(POSE))))
        sigma = None if pose is None else math.sqrt(max(pose.xx + pose.yy, 0.0))
        return Known(self._floors.get(self.floor, ()), gate_mm(sigma))


class _Eye:
    """The camera's view of the wall. Mutable: the last position, the last image's time, and the readiness."""

    def __init__(self, name: str, geometry: LevelCamera, period_s: float, *, lock: bool) -> None:
        self._name, self._geometry, self._period_s = name, geometry, period_s
        self._ready = False
        self._lock = lock
        count = min(geometry.rows, 2 * math.ceil(BAND * geometry.rows / 2.0))
        self._band = scan_band(geometry) if lock else ((geometry.rows - count) // 2, count)
        self._last: Position | None = None
        self._seen_ns = -1

    def prepare(self) -> Generator[Step, Any, None]:
        """Prepare the camera, if it is there."""
        self._ready = yield from made_ready(self._name, self._geometry, self._period_s)

    def look(self) -> Generator[Step, Any, View | None]:
        """Return the present view, or None if there is nothing new."""
        here = yield from _answer("RServer", robot.position())
        if here is None:
            return None
        last, self._last = self._last, here
        goal = yield from _answer("DServer", data.get(GOAL_DIRECTION))
        tilt = _tilt(here.heading, goal)
        if tilt is not None and is_too_steep(tilt):
            return View(here.t_ns, None, 0, _pose(here), tilt, None)
        if not self._ready:
            yield from self.prepare()
        band = (yield from self._grab()) if self._ready else None
        if band is None or band.t_ns == self._seen_ns or here.t_ns - band.t_ns > OLDEST_IMAGE_S * 1e9:
            return None
        self._seen_ns = band.t_ns
        scan = yield from _answer("PServer", proximity.sonar())
        distance = None if scan is None else SonarModel().ring_mm + scan.ranges[SIDEWARD]
        then = position_at(band.t_ns, here, last)
        gray = gray_image(cameras.array(band))
        return View(band.t_ns, gray, band.first_row, _pose(then), _tilt(then.heading, goal), distance)

    def _grab(self) -> Generator[Step, Any, Image | None]:
        """Return the rows around the middle of the newest image.

        They come in one answer, and so are of one image; as printed, they are under the lock all the same.
        """
        if self._lock:
            try:
                yield from do(self._name, cameras.lock(wait_s=0.1))
            except SILENT:
                return None
        band = yield from _answer(self._name, cameras.grab_rows(*self._band))
        if self._lock:
            yield from _answer(self._name, cameras.unlock())
        self._ready = band is not None and band.t_ns != self._seen_ns
        return band


def _tilt(heading_deg: float, goal: object) -> float | None:
    """Return the angle of a heading from the direction of the goal, counterclockwise."""
    if not isinstance(goal, int | float) or not math.isfinite(goal):
        return None
    return math.remainder(heading_deg - goal, 360.0)


def _pose(position: Position) -> Pose:
    return Pose(position.x, position.y, position.heading)


def _answer(server: str, ask: Ask[T]) -> Generator[Step, Any, T | None]:
    """Return a server's answer, or None if it does not answer."""
    try:
        return (yield from do(server, ask))
    except SILENT:
        return None
