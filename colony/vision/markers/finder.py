"""The marker finder: finds the marker of the elevator that the robot is to take (thesis section 5.4.6).

While GoalType is that of an elevator, it searches an image of the front camera every 0.2 s: the middle half
of the rows, and after a detection only those around the marker. It sets MarkerBearing, MarkerFacing and
MarkerDistance to the marker's position relative to the robot at that time. Without a marker in view they are
not set, and so become stale.

With an ElevatorCall, only the marker of that elevator counts while the robot is on the call's floor; without
a call, the widest marker in view counts. A marker of the floor's map gives a fix of the pose, MarkerFix.

A call to a server that does not answer is repeated in the next period.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Mapping, Sequence
from typing import Any

from colony.nav.maps.signs import Marker
from colony.nav.pose.pose import Fix, fix_list
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
    read_variables,
)
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import camera as library
from colony.runtime.library import data, robot
from colony.runtime.library.robot import Position
from colony.runtime.protocol.images import Image
from colony.vision.detections import MarkerBox
from colony.vision.level_camera import AHEAD, LevelCamera, prepare_camera
from colony.vision.lights.observing import NO_ANSWER_ERRORS
from colony.vision.lights.tracker import position_at
from colony.vision.markers.rows import MarkerPose, find_markers, marker_pose, marker_rows

PERIOD_S = 0.2
"""Seconds between two images: 6 degrees of a sweep."""

IDLE_S = 0.5
"""Seconds between two checks whether an elevator is to be taken."""

GATE_DEG, GATE_MM = 30.0, 1_500.0
"""Gates for the difference of a marker's heading and position from the map, by the estimated pose."""

MAX_TURNED_DEG = 110.0
"""Maximum turn away from the doors at which images are searched; beyond it, the robot is in the cabin."""

_MARGIN_ROWS = 6
_MAX_IMAGE_AGE_S = 0.5
_POSITIONS = 8


def marker_finder(
    floors: Mapping[str, Sequence[Marker]],
    *,
    camera: str = "CServerFront",
    geometry: LevelCamera = AHEAD,
) -> Script:
    """Publish the position of the marker of the elevator that the robot is to take, forever.

    Args:
        floors: the markers of each floor, by the name of its map (`nav.signs.markers_of`).
        camera: the server of the camera that looks ahead.
        geometry: the geometry of that camera.

    Raises:
        ValueError: in the script, if the size of the camera's images is not that of `geometry`.
    """
    return _run(_Finder(floors, camera, geometry), PERIOD_S)


def _run(finder: _Finder, period_s: float) -> Script:
    ready = False
    while True:
        doors_deg = yield from _doors_deg()
        if doors_deg is None:
            finder.discard()
            yield from sleep(IDLE_S)
            continue
        ready = ready or (yield from prepare_camera(finder.camera, finder.geometry, period_s))
        try:
            ready = ready and (yield from finder.search(doors_deg))
        except NO_ANSWER_ERRORS:
            ready = False
        yield from sleep(period_s)


def _doors_deg() -> Generator[Step, Any, float | None]:
    """Return the heading at which the robot faces the elevator doors, by its goal.

    None if the goal is not an elevator, or DServer has no goal.
    """
    try:
        variables = yield from read_variables(GOAL_TYPE, GOAL_DIRECTION)
    except NO_ANSWER_ERRORS:
        return None
    if variables is None or variables[GOAL_TYPE] != GoalKind.ELEVATOR:
        return None
    doors_deg = variables[GOAL_DIRECTION]
    return float(doors_deg) if isinstance(doors_deg, int | float) and math.isfinite(doors_deg) else None


class _Finder:
    """The finder. Mutable."""

    def __init__(self, floors: Mapping[str, Sequence[Marker]], camera: str, geometry: LevelCamera) -> None:
        self._floors = floors
        self.camera, self.geometry = camera, geometry
        self._positions: deque[Position] = deque(maxlen=_POSITIONS)
        self._middle_half = range(geometry.rows // 4, geometry.rows - geometry.rows // 4)
        self._rows = self._middle_half
        self._newest_ns = -1

    def discard(self) -> None:
        """Discard the last detection and positions: at the next goal the robot is elsewhere."""
        self._positions.clear()
        self._rows = self._middle_half

    def search(self, doors_deg: float) -> Generator[Step, Any, bool]:
        """Search the newest image, and publish the marker; return False if the camera has no new image.

        Args:
            doors_deg: heading at which the robot faces the doors, by its goal.

        Raises:
            CallRefusedError, ConnectionLostError, ServerNotFoundError, CallTimeoutError: a server does not
                answer.
        """
        here = yield from do("RServer", robot.position())
        if abs(math.remainder(here.heading - doors_deg, 360.0)) > MAX_TURNED_DEG:
            return True
        band = yield from do(self.camera, library.grab_rows(self._rows.start, len(self._rows)))
        here = yield from do("RServer", robot.position())
        if not self._positions or here.t_ns > self._positions[-1].t_ns:
            self._positions.append(here)
        if band.t_ns == self._newest_ns or here.t_ns - band.t_ns > _MAX_IMAGE_AGE_S * 1e9:
            return False
        self._newest_ns = band.t_ns
        boxes = find_markers(library.array(band), range(band.height), self.geometry)
        selected = yield from self._select(boxes)
        self._rows = self._rows_around(band, selected[0]) if selected else self._middle_half
        if selected:
            yield from self._publish(band.t_ns, *selected)
        return True

    def _select(
        self, boxes: Sequence[MarkerBox]
    ) -> Generator[Step, Any, tuple[MarkerBox, MarkerPose, tuple[Marker, ...]] | None]:
        """Return the marker to publish: its box, its pose, and the map's markers with its code."""
        seen = [(box, pose) for box in boxes if (pose := marker_pose(box, self.geometry)) is not None]
        if not seen:
            return None
        called_marker, markers = yield from self._called_marker()
        if called_marker is not None:
            seen = [(box, pose) for box, pose in seen if box.code == called_marker.code]
        if not seen:
            return None
        box, pose = max(seen, key=lambda found: found[0].right - found[0].left)
        return box, pose, tuple(marker for marker in markers if marker.code == box.code)

    def _called_marker(self) -> Generator[Step, Any, tuple[Marker | None, Sequence[Marker]]]:
        """Return the called elevator's marker, or None, and the markers that count: it or the floor's."""
        floor = yield from read_variables(FLOOR)
        call = yield from read_variables(ELEVATOR_CALL)
        name = floor[FLOOR] if floor is not None else None
        markers = self._floors.get(name, ()) if isinstance(name, str) else _single_floor(self._floors)
        called = call[ELEVATOR_CALL] if call is not None else ()
        node = called[0] if isinstance(called, list | tuple) and called else None
        called_marker = next((marker for marker in markers if marker.node == node), None)
        return called_marker, markers if called_marker is None else (called_marker,)

    def _rows_around(self, band: Image, box: MarkerBox) -> range:
        """Return the rows around a marker, within the middle half of the image."""
        first = max(band.first_row + box.first_row - _MARGIN_ROWS, self._middle_half.start)
        end = min(band.first_row + box.last_row + 1 + _MARGIN_ROWS, self._middle_half.stop)
        return range(first, end)

    def _publish(
        self, t_ns: int, box: MarkerBox, pose: MarkerPose, markers: Sequence[Marker]
    ) -> Generator[Step, Any, None]:
        positions = tuple(self._positions)
        then, now = position_at(positions, t_ns), positions[-1]
        bearing, distance = _relative_to(pose, then, now)
        variables: dict[str, object] = {
            MARKER_BEARING: bearing,
            MARKER_FACING: math.remainder(then.heading + pose.facing_deg - now.heading, 360.0),
            MARKER_DISTANCE: distance,
        }
        matching = [marker for marker in markers if matches_map(pose, marker, then)]
        if len(matching) == 1:
            variables[MARKER_FIX] = fix_list(Fix(t_ns, marker_rows(pose, matching[0], then)))
        yield from do("DServer", data.set_many(variables))


def matches_map(pose: MarkerPose, marker: Marker, here: Position) -> bool:
    """Return True if an observed marker may be `marker` of the map, given the robot's estimated position."""
    along = math.radians(here.heading + pose.bearing_deg)
    east = here.x - pose.distance_mm * math.sin(along)
    north = here.y + pose.distance_mm * math.cos(along)
    offset_mm = math.hypot(marker.center.x - east, marker.center.y - north)
    turned_deg = math.remainder(here.heading + pose.facing_deg - marker.heading_deg, 360.0)
    return offset_mm <= GATE_MM and abs(turned_deg) <= GATE_DEG


def _relative_to(pose: MarkerPose, then: Position, now: Position) -> tuple[float, float]:
    """Return the bearing and the distance of a marker from the robot's current position."""
    along = math.radians(then.heading + pose.bearing_deg)
    east = then.x - pose.distance_mm * math.sin(along) - now.x
    north = then.y + pose.distance_mm * math.cos(along) - now.y
    bearing = math.degrees(math.atan2(-east, north)) - now.heading
    return math.remainder(bearing, 360.0), math.hypot(east, north)


def _single_floor(floors: Mapping[str, Sequence[Marker]]) -> Sequence[Marker]:
    """Return the markers of a building with a single floor; none for other buildings."""
    return next(iter(floors.values())) if len(floors) == 1 else ()
