"""The search for plates, image by image, with or without the map.

A search takes the camera's views, with the robot's estimated pose, and returns new plates and, by plates of
the map, fixes of the robot's pose.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.signs import PLATE_WIDTH_MM, Plate
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.pose import Fix
from colony.vision.detections import PlateBox, PlateReading
from colony.vision.gray_images import Gray
from colony.vision.level_camera import LevelCamera
from colony.vision.plates.detector import find_plates
from colony.vision.plates.observations import (
    DEPTH_SIGMA,
    FoundPlate,
    PlateObservation,
    fix_of_plate,
    match_plate,
    observe_plate,
)

# --- tracks -------------------------------------------------------------------------------------------
#
# Tracks of plates over several images.
#
# A Kalman filter estimates the position of a plate from its observations, each of which is accurate across
# the line of sight and less so along it. A detection within the gate of a track is the same plate; an image
# that should show a plate but does not counts against it. A jump of the robot's position is a correction by
# another client, and moves all positions with it.

CROSS_GATE_MM = 300.0
"""Gate of an observation across the line of sight: two plates are always farther apart."""

DEPTH_GATE = 0.2
"""Gate of an observation along the line of sight, as a fraction of the distance."""

DROP_MM = 6_000.0
"""Distance beyond which a track is dropped; if the robot returns, the plate is reported again."""

MAX_OBSERVATIONS = 24
"""Maximum number of observations kept per plate."""

_CROSS_SIGMA = 0.012  # fraction of the range, due to the heading
_MIN_SIGMA_MM = 10.0
_DRIFT_MM = 12.0  # drift of the odometry between observations
_SURE_MISSES = 4
_MIN_BASELINE_MM = 240.0  # from positions closer together, observations do not reveal an object's distance
_RIM_PIXELS = 8.0  # a plate nearer to the rim of the image may be missed
_MAX_SPEED_MM_S, _MAX_TURN_DEG_S = 800.0, 100.0
_SLACK_MM, _SLACK_DEG = 20.0, 1.5

Floats = NDArray[np.float64]


@dataclass(slots=True, kw_only=True, eq=False)
class PlateTrack:
    """A track of a possible plate. Mutable.

    Attributes:
        place, covariance: estimated position of its center, (2,) in mm, and its covariance, (2, 2).
        observations: the newest observations assigned to it, oldest first.
        origins, places: the position of the robot, and of the plate, at each of these observations, in mm.
        count, evidence: number of all observations, and the sum of their scores.
        misses: number of images that should have shown it, and did not.
        reported: True after the plate was reported.
        door: its door on the map; None if unknown.
    """

    place: Floats
    covariance: Floats
    observations: deque[PlateObservation] = field(default_factory=partial(deque, maxlen=MAX_OBSERVATIONS))
    origins: deque[Floats] = field(default_factory=partial(deque, maxlen=MAX_OBSERVATIONS))
    places: deque[Floats] = field(default_factory=partial(deque, maxlen=MAX_OBSERVATIONS))
    count: int = 0
    evidence: float = 0.0
    misses: int = 0
    reported: bool = False
    door: str | None = None

    @property
    def hit_fraction(self) -> float:
        """Fraction of hits among the images that should show the plate."""
        return self.count / (self.count + self.misses)

    @property
    def drift(self) -> float:
        """Apparent motion of the track with the robot, as a fraction of the distance traveled.

        It is about 0 for a plate, and larger for objects of other sizes, whose distances are estimated
        wrongly. The median over pairs of observations makes it robust to a jump of the position.
        """
        origins, places = np.array(self.origins), np.array(self.places)
        travels, moves = origins[:, None] - origins[None], places[:, None] - places[None]
        squared = (travels**2).sum(axis=2)
        far = squared >= _MIN_BASELINE_MM**2
        return float(np.median((travels * moves).sum(axis=2)[far] / squared[far])) if far.any() else 0.0

    @property
    def rise_mm(self) -> float:
        """Height of its center above the camera, by all observations."""
        return float(np.median([observation.rise_mm for observation in self.observations]))

    @classmethod
    def start(cls, observation: PlateObservation) -> PlateTrack:
        """Start a track with one observation."""
        track = cls(place=np.array(observation.place), covariance=_covariance(observation))
        track._add(observation)
        return track

    def update(self, observation: PlateObservation) -> None:
        """Update the Kalman filter of the position with an observation."""
        noise = _covariance(observation)
        prior = self.covariance + np.eye(2) * _DRIFT_MM**2
        gain = prior @ np.linalg.inv(prior + noise)
        self.place = self.place + gain @ (np.array(observation.place) - self.place)
        self.covariance = (np.eye(2) - gain) @ prior
        self._add(observation)

    def move(self, rotation: Floats, here: Floats, there: Floats) -> None:
        """Turn all positions about `here`, and move them so that `here` becomes `there`."""

        def at(place: Floats) -> Floats:
            return np.asarray(there + rotation @ (place - here))

        self.place, self.covariance = at(self.place), rotation @ self.covariance @ rotation.T
        self.origins = deque(map(at, self.origins), maxlen=MAX_OBSERVATIONS)
        self.places = deque(map(at, self.places), maxlen=MAX_OBSERVATIONS)

    def _add(self, observation: PlateObservation) -> None:
        self.count += 1
        self.evidence += observation.score
        self.observations.append(observation)
        self.origins.append(np.array([observation.robot.x_mm, observation.robot.y_mm]))
        self.places.append(np.array(observation.place))


class PlateTracks:
    """The tracks near the robot. Mutable."""

    def __init__(self, camera: LevelCamera) -> None:
        """Start without tracks."""
        self._camera = camera
        self._tracks: list[PlateTrack] = []
        self._last: tuple[int, Pose] | None = None

    @property
    def tracks(self) -> tuple[PlateTrack, ...]:
        """All tracks, the oldest first."""
        return tuple(self._tracks)

    def update(
        self, t_ns: int, robot: Pose, observations: Sequence[PlateObservation]
    ) -> tuple[PlateTrack, ...]:
        """Update the tracks with an image's observations; return the track of each, in the same order."""
        self.move(t_ns, robot)
        unmatched = list(self._tracks)
        matched: list[PlateTrack] = []
        for observation in observations:
            track = _nearest(observation, unmatched)
            if track is None:
                track = PlateTrack.start(observation)
                self._tracks.append(track)
            else:
                unmatched.remove(track)
                track.update(observation)
            matched.append(track)
        for track in unmatched:
            if self.is_in_view(track):
                track.misses += 1
        self._tracks = [track for track in self._tracks if _is_worth_keeping(track, robot)]
        return tuple(matched)

    def move(self, t_ns: int, robot: Pose) -> None:
        """Record the robot's pose; if its position was corrected, move all positions with it."""
        last, self._last = self._last, (t_ns, robot)
        if last is None:
            return
        elapsed_s = max(t_ns - last[0], 0) / 1e9
        before = last[1]
        turned = math.remainder(robot.heading_deg - before.heading_deg, 360.0)
        travel_mm = math.hypot(robot.x_mm - before.x_mm, robot.y_mm - before.y_mm)
        if (
            travel_mm <= _MAX_SPEED_MM_S * elapsed_s + _SLACK_MM
            and abs(turned) <= _MAX_TURN_DEG_S * elapsed_s + _SLACK_DEG
        ):
            return
        sine, cosine = math.sin(math.radians(turned)), math.cos(math.radians(turned))
        rotation = np.array([[cosine, -sine], [sine, cosine]])
        here, there = np.array([before.x_mm, before.y_mm]), np.array([robot.x_mm, robot.y_mm])
        for track in self._tracks:
            track.move(rotation, here, there)

    def is_in_view(self, track: PlateTrack) -> bool:
        """Return True if a whole plate at the track's position would be in the newest image."""
        if self._last is None:
            return False
        robot = self._last[1]
        axis = math.radians(robot.heading_deg + self._camera.yaw_deg)
        dx, dy = (track.place - (robot.x_mm, robot.y_mm)).tolist()
        depth, right = -math.sin(axis) * dx + math.cos(axis) * dy, math.cos(axis) * dx + math.sin(axis) * dy
        if depth <= PLATE_WIDTH_MM:
            return False
        half = self._camera.focal * (abs(right) + PLATE_WIDTH_MM / 2.0) / depth
        return bool(half < self._camera.columns / 2.0 - _RIM_PIXELS)


def _covariance(observation: PlateObservation) -> Floats:
    """Return the covariance of the position by one observation."""
    along = _MIN_SIGMA_MM + DEPTH_SIGMA * observation.range_mm
    cross = _MIN_SIGMA_MM + _CROSS_SIGMA * observation.range_mm
    x, y = observation.ray
    ray, across = np.array([x, y]), np.array([y, -x])
    return np.asarray(along**2 * np.outer(ray, ray) + cross**2 * np.outer(across, across))


def _nearest(observation: PlateObservation, tracks: Sequence[PlateTrack]) -> PlateTrack | None:
    """Return the nearest track within the gates of an observation, or None."""
    x, y = observation.ray
    candidates: list[tuple[float, PlateTrack]] = []
    for track in tracks:
        dx, dy = (track.place - observation.place).tolist()
        along, cross = abs(x * dx + y * dy), abs(y * dx - x * dy)
        if cross < CROSS_GATE_MM and along < DEPTH_GATE * observation.range_mm + CROSS_GATE_MM / 2.0:
            candidates.append((math.hypot(along / 2.0, cross), track))
    return min(candidates, key=lambda match: match[0])[1] if candidates else None


def _is_worth_keeping(track: PlateTrack, robot: Pose) -> bool:
    distance_mm = math.hypot(*(track.place - (robot.x_mm, robot.y_mm)).tolist())
    missing = track.misses >= _SURE_MISSES and track.misses > 2 * track.count
    return distance_mm < DROP_MM and (track.reported or not missing)


# --- search -------------------------------------------------------------------------------------------

MAX_TILT_DEG = 50.0
"""Angle between the axis and the wall's normal from which on measurements are too uncertain for a search."""

MIN_OBSERVATIONS, MIN_EVIDENCE, MIN_HIT_FRACTION = 3, 1.5, 0.4
"""Thresholds for reporting a plate without a map.

They apply to the number of observations, to the sum of their scores, and to the fraction of hits among the
images that should show the plate.
"""

MAX_DRIFT = 0.15
"""Maximum apparent motion of a plate with the robot, as a fraction of the distance traveled.

An object that seems to move more does not have the size of a plate.
"""

MAX_RISE_MM = 20.0
"""Maximum distance of a plate above or below the camera, by all observations."""

MIN_AGREEMENT = 0.45
"""Minimum fraction of the observations with the same text: other objects read differently each time."""

KNOWN_PLATE_OBSERVATIONS, KNOWN_PLATE_EVIDENCE = 2, 0.6
"""Minimum number of observations, and minimum evidence, of a plate that the map has at this position."""

SETTLED_OBSERVATIONS = 6
"""Number of observations after which a plate is reported; a plate that leaves the view is reported earlier.

More observations make a better reading.
"""

UNREAD = PlateReading("", 0.0)

Reader = Callable[[Gray, PlateBox], PlateReading]
"""Reads the text on a plate in an image."""


def is_too_steep(tilt_deg: float) -> bool:
    """Return True if plates are not searched for at this tilt (beta)."""
    return not abs(tilt_deg) < MAX_TILT_DEG


class View(NamedTuple):
    """The camera's view of the wall.

    Attributes:
        t_ns: time of the image.
        band: rows of the image from `first_row` on; None without a usable image.
        robot: estimated pose of the robot.
        tilt_deg: angle beta between the optical axis and the wall's normal; None if the direction of the
            hallway is unknown.
        floor: the robot's floor, "" if unknown.
    """

    t_ns: int
    band: Gray | None
    first_row: int
    robot: Pose
    tilt_deg: float | None
    floor: str = ""


class FloorPlates(NamedTuple):
    """The plates of a floor's map, and the gate for their distance from an observation, in mm."""

    plates: Sequence[Plate]
    gate_mm: float


class SearchResult(NamedTuple):
    """The plates to report now, and the fixes of the robot's pose."""

    plates: tuple[FoundPlate, ...] = ()
    fixes: tuple[Fix, ...] = ()


class PlateSearch:
    """The search with or without a map. Mutable.

    Args:
        reader: reader of the texts; None to leave plates unread.
    """

    def __init__(self, camera: LevelCamera, reader: Reader | None = None) -> None:
        self._camera = camera
        self._reader = reader
        self._tracks = PlateTracks(camera)
        self._floor = ""

    def update(self, view: View, floor_plates: FloorPlates | None = None) -> SearchResult:
        """Update the tracks with a view; return the new plates and the fixes."""
        if view.floor != self._floor:  # a plate at the same position on another floor is another plate
            self._floor, self._tracks = view.floor, PlateTracks(self._camera)
        visible_tracks = self._update_tracks(view)
        fixes = [
            fix_of_plate(track.observations[-1], plate)
            for track in visible_tracks
            if floor_plates is not None and (plate := self._identify(track, floor_plates)) is not None
        ]
        plates = [
            self._report(track)
            for track in self._tracks.tracks
            if not track.reported
            and self._is_settled(track, track in visible_tracks)
            and self._is_confirmed(track, floor_plates)
        ]
        return SearchResult(tuple(plates), tuple(fixes))

    def _update_tracks(self, view: View) -> tuple[PlateTrack, ...]:
        """Update the tracks with a view, and return the tracks of the plates in it."""
        if view.band is None or (view.tilt_deg is not None and is_too_steep(view.tilt_deg)):
            self._tracks.move(view.t_ns, view.robot)
            return ()
        boxes = find_plates(view.band, self._camera, first_row=view.first_row, tilt_deg=view.tilt_deg)
        seen = [observe_box(view.band, box, view, self._camera, self._reader) for box in boxes]
        return self._tracks.update(view.t_ns, view.robot, seen)

    def _identify(self, track: PlateTrack, floor_plates: FloorPlates) -> Plate | None:
        """Return the map's plate of a track, or None if unknown."""
        if track.door is None and track.count >= KNOWN_PLATE_OBSERVATIONS:
            reading = self._read(track)
            x, y = track.place.tolist()
            plate = match_plate(
                (x, y), track.observations[-1], reading.text, reading.confidence, floor_plates.plates,
                gate=floor_plates.gate_mm,
                taken=(other.door for other in self._tracks.tracks if other.door is not None),
            )  # fmt: skip
            track.door = None if plate is None else plate.door
        return next((plate for plate in floor_plates.plates if plate.door == track.door), None)

    def _is_settled(self, track: PlateTrack, is_in_image: bool) -> bool:
        """Return True if a track can be reported: it has enough observations, or has left the view."""
        if track.count >= SETTLED_OBSERVATIONS:
            return True
        return not is_in_image and not self._tracks.is_in_view(track)

    def _is_confirmed(self, track: PlateTrack, floor_plates: FloorPlates | None) -> bool:
        """Return True if enough observations confirm that a track is a plate."""
        if floor_plates is not None:
            return (
                track.door is not None
                and track.count >= KNOWN_PLATE_OBSERVATIONS
                and track.evidence >= KNOWN_PLATE_EVIDENCE
            )
        return (
            track.count >= MIN_OBSERVATIONS
            and track.evidence >= MIN_EVIDENCE
            and track.hit_fraction >= MIN_HIT_FRACTION
            and abs(track.drift) <= MAX_DRIFT
            and abs(track.rise_mm) <= MAX_RISE_MM
            and (self._reader is None or self._is_legible(track))
        )

    def _is_legible(self, track: PlateTrack) -> bool:
        """Return True if the observations agree on a text."""
        text = self._read(track).text
        alike = sum(observation.reading.text == text for observation in track.observations)
        return text != "" and alike >= MIN_AGREEMENT * len(track.observations)

    def _report(self, track: PlateTrack) -> FoundPlate:
        track.reported = True
        reading = self._read(track)
        x, y = track.place.tolist()
        newest = track.observations[-1]
        return FoundPlate(
            t_ns=newest.t_ns, door=track.door, text=reading.text, confidence=reading.confidence,
            place=(x, y), robot=newest.robot, images=track.count,
        )  # fmt: skip

    def _read(self, track: PlateTrack) -> PlateReading:
        """Return the combined reading of a track's observations."""
        if self._reader is None:
            return UNREAD
        from colony.vision.plates.reader import combine_readings

        return combine_readings([observation.reading for observation in track.observations])


def observe_box(
    band: Gray, box: PlateBox, view: View, camera: LevelCamera, reader: Reader | None
) -> PlateObservation:
    """Read a plate, and return its observation."""
    reading = UNREAD if reader is None else reader(band, box)
    return observe_plate(box, camera, view.robot, t_ns=view.t_ns, reading=reading, first_row=view.first_row)
