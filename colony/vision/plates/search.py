"""The search for plates, image by image: ours, with the map or without it, and the thesis's (section 5.7).

A search is shown what the camera sees, with where the robot believes to be, and gives the plates that it
counts and, from plates known from the map, observations of the robot's pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from colony.nav.maps.signs import Plate
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.fixes import Fix
from colony.vision.gray_images import Gray
from colony.vision.level_camera import LevelCamera
from colony.vision.plates.detector import find_plates
from colony.vision.plates.geometry import WallView, is_too_steep, starting_column
from colony.vision.plates.map import known_plate
from colony.vision.plates.sights import PlateSight, Seen, fix_of_plate, seen_of
from colony.vision.plates.thesis import thesis_plates
from colony.vision.plates.tracks import PlateTracks, Track
from colony.vision.sightings import PlateBox, Reading

LEAST_LOOKS, LEAST_EVIDENCE, LEAST_HITS = 3, 1.5, 0.4
"""Thresholds of a plate where the map is not known.

The number of looks, the sum of their scores, and the part of the images that should show it in which it was
found.
"""

MOST_DRIFT = 0.15
"""Largest apparent motion of a plate with the robot, as a part of the robot's way.

What seems to move more is of another size than a plate.
"""

MOST_RISE_MM = 20.0
"""Largest height of a plate above or below the camera, by all looks."""

LEAST_AGREEMENT = 0.45
"""Least part of the looks with the same text: what is no plate reads differently each time."""

KNOWN_LOOKS, KNOWN_EVIDENCE = 2, 0.6
"""Looks and evidence for a plate that the map has at this place."""

SETTLED_LOOKS = 6
"""Number of looks after which a plate is reported; earlier if it leaves the view.

More looks make a better reading.
"""

UNREAD = Reading("", 0.0)

Reader = Callable[[Gray, PlateBox], Reading]
"""Reads what is written on a plate in an image."""


class View(NamedTuple):
    """The view of the camera.

    Attributes:
        t_ns: time of the image.
        band: the rows from `first_row` on; None if there was nothing to look at.
        robot: believed pose of the robot.
        tilt_deg: beta, None if no direction is known.
        distance_mm: d, from the camera to the wall by sonar; None if that is silent.
        floor: the robot's floor, "" if unknown.
    """

    t_ns: int
    band: Gray | None
    first_row: int
    robot: Pose
    tilt_deg: float | None
    distance_mm: float | None
    floor: str = ""


class Known(NamedTuple):
    """The map: its plates, and how far one may seem to be from its place, in mm."""

    plates: Sequence[Plate]
    gate_mm: float


class Found(NamedTuple):
    """Plates that count from now on, and what is known of the pose."""

    told: tuple[PlateSight, ...] = ()
    fixes: tuple[Fix, ...] = ()


class PlateSearch:
    """Ours. Mutable: what it tracks, and on which floor.

    Args:
        reader: None: nothing is read.
    """

    def __init__(self, camera: LevelCamera, reader: Reader | None = None) -> None:
        self._camera = camera
        self._reader = reader
        self._tracks = PlateTracks(camera)
        self._floor = ""

    def look(self, view: View, known: Known | None = None) -> Found:
        """Take in what the camera sees."""
        if view.floor != self._floor:  # what hangs at the same place on another floor is another plate
            self._floor, self._tracks = view.floor, PlateTracks(self._camera)
        now = self._seen(view)
        fixes = [
            fix_of_plate(track.looks[-1], plate)
            for track in now
            if known is not None and (plate := self._identified(track, known)) is not None
        ]
        told = [
            self._told(track)
            for track in self._tracks.tracks
            if not track.counted and self._is_settled(track, track in now) and self._counts(track, known)
        ]
        return Found(tuple(told), tuple(fixes))

    def _seen(self, view: View) -> tuple[Track, ...]:
        """Return the tracks of the plates in the image."""
        if view.band is None or (view.tilt_deg is not None and is_too_steep(view.tilt_deg)):
            self._tracks.go(view.t_ns, view.robot)
            return ()
        boxes = find_plates(view.band, self._camera, first_row=view.first_row, tilt_deg=view.tilt_deg)
        seen = [_seen(view.band, box, view, self._camera, self._reader) for box in boxes]
        return self._tracks.see(view.t_ns, view.robot, seen)

    def _identified(self, track: Track, known: Known) -> Plate | None:
        """Return the map's plate that a track is."""
        if track.door is None and track.count >= KNOWN_LOOKS:
            reading = self._read(track)
            x, y = track.place.tolist()
            plate = known_plate(
                (x, y), track.looks[-1], reading.text, reading.confidence, known.plates,
                gate=known.gate_mm,
                taken=(other.door for other in self._tracks.tracks if other.door is not None),
            )  # fmt: skip
            track.door = None if plate is None else plate.door
        return next((plate for plate in known.plates if plate.door == track.door), None)

    def _is_settled(self, track: Track, is_seen: bool) -> bool:
        """Return True if a track is ready to be reported: it has many looks, or has left the view."""
        if track.count >= SETTLED_LOOKS:
            return True
        return not is_seen and not self._tracks.is_in_view(track)

    def _counts(self, track: Track, known: Known | None) -> bool:
        """Return True if enough looks agree that a track is a plate."""
        if known is not None:
            return track.door is not None and track.count >= KNOWN_LOOKS and track.evidence >= KNOWN_EVIDENCE
        return (
            track.count >= LEAST_LOOKS
            and track.evidence >= LEAST_EVIDENCE
            and track.hits >= LEAST_HITS
            and abs(track.drift) <= MOST_DRIFT
            and abs(track.rise_mm) <= MOST_RISE_MM
            and (self._reader is None or self._is_written(track))
        )

    def _is_written(self, track: Track) -> bool:
        """Return True if the looks agree on the text."""
        text = self._read(track).text
        alike = sum(look.reading.text == text for look in track.looks)
        return text != "" and alike >= LEAST_AGREEMENT * len(track.looks)

    def _told(self, track: Track) -> PlateSight:
        track.counted = True
        reading = self._read(track)
        x, y = track.place.tolist()
        newest = track.looks[-1]
        return PlateSight(
            t_ns=newest.t_ns, door=track.door, text=reading.text, confidence=reading.confidence,
            place=(x, y), robot=newest.robot, looks=track.count,
        )  # fmt: skip

    def _read(self, track: Track) -> Reading:
        """Return the reading of a track, by all looks."""
        if self._reader is None:
            return UNREAD
        from colony.vision.plates.reader import combined

        return combined([look.reading for look in track.looks])


class ThesisSearch:
    """The search as printed: what is in a part of the wall that was not in the last image is a new plate.

    The last image is the last one with a plate. Mutable: where that image was taken.
    """

    def __init__(self, camera: LevelCamera, reader: Reader | None = None) -> None:
        self._camera = camera
        self._reader = reader
        self._last: tuple[WallView, Pose] | None = None

    def look(self, view: View, known: Known | None = None) -> Found:
        """Take in what the camera sees. It knows no map."""
        if view.band is None or view.tilt_deg is None or is_too_steep(view.tilt_deg):
            return Found()
        if view.distance_mm is None or not 0.0 < view.distance_mm < math.inf:
            return Found()
        wall = WallView(view.distance_mm, view.tilt_deg)
        start = self._start(wall, view.robot)
        boxes = thesis_plates(view.band, self._camera, first_row=view.first_row, starting_column=start)
        if boxes:
            self._last = wall, view.robot
        return Found(tuple(self._told(view, view.band, box) for box in boxes))

    def _start(self, wall: WallView, here: Pose) -> int:
        """Return the first column of wall that was not in the last image with a plate."""
        if self._last is None:
            return 0
        before, there = self._last
        moved = math.hypot(here.x_mm - there.x_mm, here.y_mm - there.y_mm)
        return starting_column(before, wall, moved, self._camera)

    def _told(self, view: View, band: Gray, box: PlateBox) -> PlateSight:
        seen = _seen(band, box, view, self._camera, self._reader)
        return PlateSight(
            t_ns=view.t_ns, door=None, text=seen.reading.text, confidence=seen.reading.confidence,
            place=seen.place, robot=view.robot, looks=1,
        )  # fmt: skip


def _seen(band: Gray, box: PlateBox, view: View, camera: LevelCamera, reader: Reader | None) -> Seen:
    """Read a plate, and return where it is as seen from the robot."""
    reading = UNREAD if reader is None else reader(band, box)
    return seen_of(box, camera, view.robot, t_ns=view.t_ns, reading=reading, first_row=view.first_row)


Search = PlateSearch | ThesisSearch
