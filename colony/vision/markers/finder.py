"""The marker finder: looks for the marker of an elevator that the robot is to take (thesis section 5.4.6).

While GoalType is that of an elevator it looks at the camera ahead every 0.2 s: at the middle half of the
image, and after a sighting only at the rows around the marker. MarkerBearing, MarkerFacing and MarkerDistance
are the marker's place relative to the robot at the time when they are set. Without a marker in view nothing
is set, so that they grow old.

ElevatorCall names the elevator, and then only its marker counts, while the robot is on its floor; without a
call, the widest one. A marker that the map of the floor has makes a fix of the pose, MarkerFix.

A server that is away is asked again at the next look.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Mapping, Sequence
from typing import Any

from colony.nav.asks import values
from colony.nav.maps.signs import Marker
from colony.nav.pose.fixes import Fix, fix_list
from colony.nav.shared import (
    ELEVATOR_CALL,
    FLOOR,
    GOAL_DIRECTION,
    GOAL_TYPE,
    MARKER_BEARING,
    MARKER_DISTANCE,
    MARKER_FACING,
    MARKER_FIX,
    GoalKind,
)
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import camera as library
from colony.runtime.library import data, robot
from colony.runtime.library.robot import Position
from colony.runtime.protocol.images import Image
from colony.vision.level_camera import AHEAD, LevelCamera
from colony.vision.level_looks import made_ready
from colony.vision.lights.looks import SILENT
from colony.vision.lights.tracker import position_at
from colony.vision.markers.pose import MarkerPose, marker_pose, marker_rows
from colony.vision.markers.rows import find_markers
from colony.vision.sightings import MarkerBox

PERIOD_S = 0.2
"""Seconds between two looks: 6 degrees of a sweep."""

IDLE_S = 0.5
"""Seconds between two checks whether an elevator is to be taken."""

MOST_OFF_DEG, MOST_OFF_MM = 30.0, 1_500.0
"""A marker that is farther from where the map has it, as seen from where the robot believes to be, is another
one."""

MOST_ASIDE_DEG = 110.0
"""A robot that is turned away farther than that from the doors sees no marker: it is in the cabin."""

_MARGIN_ROWS = 6
_OLDEST_IMAGE_S = 0.5
_POSITIONS = 8


def marker_finder(
    floors: Mapping[str, Sequence[Marker]],
    *,
    camera: str = "CServerFront",
    geometry: LevelCamera = AHEAD,
) -> Script:
    """Publish the place of the marker of the elevator that the robot is to take; never ends.

    Args:
        floors: the markers of each floor, by the name of its map (`nav.signs.markers_of`).
        camera: the server of the camera that looks ahead.
        geometry: the geometry of that camera.

    Raises:
        ValueError: in the script, where the camera's images are not as large as `geometry` says.
    """
    return _finder(_Finder(floors, camera, geometry), PERIOD_S)


def _finder(finder: _Finder, period_s: float) -> Script:
    ready = False
    while True:
        doors_deg = yield from _doors_deg()
        if doors_deg is None:
            finder.forget()
            yield from sleep(IDLE_S)
            continue
        ready = ready or (yield from made_ready(finder.camera, finder.geometry, period_s))
        try:
            ready = ready and (yield from finder.look(doors_deg))
        except SILENT:
            ready = False
        yield from sleep(period_s)


def _doors_deg() -> Generator[Step, Any, float | None]:
    """Return the heading at which the robot faces the elevator doors, as far as it knows.

    None if it is to take no elevator, or DServer has no goal.
    """
    try:
        told = yield from values(GOAL_TYPE, GOAL_DIRECTION)
    except SILENT:
        return None
    if told is None or told[GOAL_TYPE] != GoalKind.ELEVATOR:
        return None
    doors_deg = told[GOAL_DIRECTION]
    return float(doors_deg) if isinstance(doors_deg, int | float) and math.isfinite(doors_deg) else None


class _Finder:
    """Mutable: the robot's last positions, oldest first; the rows to look at; the time of the last image."""

    def __init__(self, floors: Mapping[str, Sequence[Marker]], camera: str, geometry: LevelCamera) -> None:
        self._floors = floors
        self.camera, self.geometry = camera, geometry
        self._positions: deque[Position] = deque(maxlen=_POSITIONS)
        self._middle_half = range(geometry.rows // 4, geometry.rows - geometry.rows // 4)
        self._rows = self._middle_half
        self._newest_ns = -1

    def forget(self) -> None:
        """Forget the last sighting: the robot is elsewhere when it looks again."""
        self._positions.clear()
        self._rows = self._middle_half

    def look(self, doors_deg: float) -> Generator[Step, Any, bool]:
        """Look once, and publish what is seen; False if the camera has no new image.

        Args:
            doors_deg: the heading at which the robot faces the doors, as far as it knows.

        Raises:
            CallRefusedError, ConnectionLostError, ServerNotFoundError, CallTimeoutError: a server does not
                answer.
        """
        here = yield from do("RServer", robot.position())
        if abs(math.remainder(here.heading - doors_deg, 360.0)) > MOST_ASIDE_DEG:
            return True
        band = yield from do(self.camera, library.grab_rows(self._rows.start, len(self._rows)))
        here = yield from do("RServer", robot.position())
        if not self._positions or here.t_ns > self._positions[-1].t_ns:
            self._positions.append(here)
        if band.t_ns == self._newest_ns or here.t_ns - band.t_ns > _OLDEST_IMAGE_S * 1e9:
            return False
        self._newest_ns = band.t_ns
        boxes = find_markers(library.array(band), range(band.height), self.geometry)
        told = yield from self._told(boxes)
        self._rows = self._confining(band, told[0]) if told else self._middle_half
        if told:
            yield from self._tell(band.t_ns, *told)
        return True

    def _told(
        self, boxes: Sequence[MarkerBox]
    ) -> Generator[Step, Any, tuple[MarkerBox, MarkerPose, tuple[Marker, ...]] | None]:
        """Return the marker that is meant: its box, its pose, and the map's marker that it may be."""
        seen = [(box, pose) for box in boxes if (pose := marker_pose(box, self.geometry)) is not None]
        if not seen:
            return None
        meant, markers = yield from self._meant()
        if meant is not None:
            seen = [(box, pose) for box, pose in seen if box.code == meant.code]
        if not seen:
            return None
        box, pose = max(seen, key=lambda one: one[0].right - one[0].left)
        return box, pose, tuple(marker for marker in markers if marker.code == box.code)

    def _meant(self) -> Generator[Step, Any, tuple[Marker | None, Sequence[Marker]]]:
        """Return the called elevator's marker, which then is the only one that counts, and the floor's."""
        floor = yield from values(FLOOR)
        call = yield from values(ELEVATOR_CALL)
        name = floor[FLOOR] if floor is not None else None
        markers = self._floors.get(name, ()) if isinstance(name, str) else _only(self._floors)
        called = call[ELEVATOR_CALL] if call is not None else ()
        node = called[0] if isinstance(called, list | tuple) and called else None
        meant = next((marker for marker in markers if marker.node == node), None)
        return meant, markers if meant is None else (meant,)

    def _confining(self, band: Image, box: MarkerBox) -> range:
        """Return the rows around a marker, within the middle half of the image."""
        first = max(band.first_row + box.first_row - _MARGIN_ROWS, self._middle_half.start)
        end = min(band.first_row + box.last_row + 1 + _MARGIN_ROWS, self._middle_half.stop)
        return range(first, end)

    def _tell(
        self, t_ns: int, box: MarkerBox, pose: MarkerPose, markers: Sequence[Marker]
    ) -> Generator[Step, Any, None]:
        positions = tuple(self._positions)
        then, now = position_at(positions, t_ns), positions[-1]
        bearing, distance = _from_there(pose, then, now)
        told: dict[str, object] = {
            MARKER_BEARING: bearing,
            MARKER_FACING: math.remainder(then.heading + pose.facing_deg - now.heading, 360.0),
            MARKER_DISTANCE: distance,
        }
        near = [marker for marker in markers if is_there(pose, marker, then)]
        if len(near) == 1:
            told[MARKER_FIX] = fix_list(Fix(t_ns, marker_rows(pose, near[0], then)))
        yield from do("DServer", data.set_many(told))


def is_there(pose: MarkerPose, marker: Marker, here: Position) -> bool:
    """Return True if an observed marker may be this one of the map, seen by a robot believed `here`."""
    along = math.radians(here.heading + pose.bearing_deg)
    east = here.x - pose.distance_mm * math.sin(along)
    north = here.y + pose.distance_mm * math.cos(along)
    off_mm = math.hypot(marker.middle.x - east, marker.middle.y - north)
    off_deg = math.remainder(here.heading + pose.facing_deg - marker.heading_deg, 360.0)
    return off_mm <= MOST_OFF_MM and abs(off_deg) <= MOST_OFF_DEG


def _from_there(pose: MarkerPose, then: Position, now: Position) -> tuple[float, float]:
    """Return the bearing and the distance of a marker for a robot that has moved on since."""
    along = math.radians(then.heading + pose.bearing_deg)
    east = then.x - pose.distance_mm * math.sin(along) - now.x
    north = then.y + pose.distance_mm * math.cos(along) - now.y
    bearing = math.degrees(math.atan2(-east, north)) - now.heading
    return math.remainder(bearing, 360.0), math.hypot(east, north)


def _only(floors: Mapping[str, Sequence[Marker]]) -> Sequence[Marker]:
    """Return the markers of the building, if it has one floor."""
    return next(iter(floors.values())) if len(floors) == 1 else ()
