"""The search for plates, image by image, with or without the map.

A search takes the camera's views, with the robot's estimated pose, and returns new plates and, by plates of
the map, fixes of the robot's pose.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from colony.nav.maps.signs import Plate
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.fixes import Fix
from colony.vision.detections import PlateBox, Reading
from colony.vision.gray_images import Gray
from colony.vision.level_camera import LevelCamera
from colony.vision.plates.detector import find_plates
from colony.vision.plates.map import match_plate
from colony.vision.plates.observations import FoundPlate, PlateObservation, fix_of_plate, observe_plate
from colony.vision.plates.tracks import PlateTracks, Track

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

UNREAD = Reading("", 0.0)

Reader = Callable[[Gray, PlateBox], Reading]
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

    def _update_tracks(self, view: View) -> tuple[Track, ...]:
        """Update the tracks with a view, and return the tracks of the plates in it."""
        if view.band is None or (view.tilt_deg is not None and is_too_steep(view.tilt_deg)):
            self._tracks.move(view.t_ns, view.robot)
            return ()
        boxes = find_plates(view.band, self._camera, first_row=view.first_row, tilt_deg=view.tilt_deg)
        seen = [observe_box(view.band, box, view, self._camera, self._reader) for box in boxes]
        return self._tracks.update(view.t_ns, view.robot, seen)

    def _identify(self, track: Track, floor_plates: FloorPlates) -> Plate | None:
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

    def _is_settled(self, track: Track, is_in_image: bool) -> bool:
        """Return True if a track can be reported: it has enough observations, or has left the view."""
        if track.count >= SETTLED_OBSERVATIONS:
            return True
        return not is_in_image and not self._tracks.is_in_view(track)

    def _is_confirmed(self, track: Track, floor_plates: FloorPlates | None) -> bool:
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

    def _is_legible(self, track: Track) -> bool:
        """Return True if the observations agree on a text."""
        text = self._read(track).text
        alike = sum(observation.reading.text == text for observation in track.observations)
        return text != "" and alike >= MIN_AGREEMENT * len(track.observations)

    def _report(self, track: Track) -> FoundPlate:
        track.reported = True
        reading = self._read(track)
        x, y = track.place.tolist()
        newest = track.observations[-1]
        return FoundPlate(
            t_ns=newest.t_ns, door=track.door, text=reading.text, confidence=reading.confidence,
            place=(x, y), robot=newest.robot, images=track.count,
        )  # fmt: skip

    def _read(self, track: Track) -> Reading:
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
