"""The search for plates, image by image: ours, with the map or without it, and the thesis's (section 5.7).

A search is shown what the camera sees, with where the robot believes to be, and gives the plates that it
counts and what those that it knows from the map tell of the robot's pose.
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
"""What makes a plate where the map is not known: so many looks, the sum of their scores, and in which part of
the images in which it should be it was found."""

MOST_DRIFT = 0.15
"""By how much a plate may seem to move with the robot, as a part of its way: what seems to move more is of
another size than a plate."""

MOST_RISE_MM = 20.0
"""How far a plate may be above or below the camera, by all looks."""

LEAST_AGREEMENT = 0.45
"""In which part of the looks what is written must be read alike: what is no plate reads now as this, now as
that, or as nothing."""

KNOWN_LOOKS, KNOWN_EVIDENCE = 2, 0.6
"""Looks and evidence for a plate that the map has at this place."""

SETTLED_LOOKS = 6
"""After so many looks a plate is told; before, when it is out of view: the more looks, the better it is
read."""

UNREAD = Reading("", 0.0)

Reader = Callable[[Gray, PlateBox], Reading]
"""Reads what is written on a plate in an image."""


class View(NamedTuple):
    """What the camera sees.

    Attributes:
        t_ns: when.
        band: the rows from `first_row` on; None where there was nothing to look at.
        robot: where the robot believed to be.
        tilt_deg: beta, None where no direction is known.
        distance_mm: d, from the camera to the wall by sonar; None where that is silent.
        floor: on which the robot is, "" where nobody knows.
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
        """What is in the image now."""
        if view.band is None or (view.tilt_deg is not None and is_too_steep(view.tilt_deg)):
            self._tracks.go(view.t_ns, view.robot)
            return ()
        boxes = find_plates(view.band, self._camera, first_row=view.first_row, tilt_deg=view.tilt_deg)
        seen = [_seen(view.band, box, view, self._camera, self._reader) for box in boxes]
        return self._tracks.see(view.t_ns, view.robot, seen)

    def _identified(self, track: Track, known: Known) -> Plate | None:
        """Which plate of the map a track is."""
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
        """Whether it is time to tell it: it was looked at often, or is not to be seen any more."""
        if track.count >= SETTLED_LOOKS:
            return True
        return not is_seen and not self._tracks.is_in_view(track)

    def _counts(self, track: Track, known: Known | None) -> bool:
        """Whether enough looks agree that it is a plate."""
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
        """Whether the looks agree what is written on it."""
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
        """What is written on it, by all looks."""
        if self._reader is None:
            return UNREAD
        from colony.vision.plates.reader import combined

        return combined([look.reading for look in track.looks])


class ThesisSearch:
    """As printed: what is in a part of the wall that was not in the last image with a plate is a new plate.
    Mutable: where that image was taken.
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
        """From which column on there is wall that was not in the last image with a plate."""
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
