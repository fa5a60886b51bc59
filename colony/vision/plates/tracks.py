"""Plates over several images: each is counted once, when enough looks agree that it is one.

A plate has a place on the wall. It is filtered over the looks at it, each of which is accurate across the
line of sight and less so along it. What is found near such a place is the same plate again; an image that
should show a plate and does not speaks against it. A jump of the believed position is a correction by another
client, and moves all places with it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.signs import PLATE_WIDTH_MM
from colony.nav.maps.stickrep.model import Pose
from colony.vision.level_camera import LevelCamera
from colony.vision.plates.sights import DEPTH_SIGMA, Seen

SAME_MM = 300.0
"""Two plates are never as near to each other, across the line of sight."""

SAME_DEPTHS = 0.2
"""Tolerance of a look along the line of sight, as a part of the distance."""

FORGET_MM = 6_000.0
"""A plate that is so far away is forgotten: if the robot comes back, it is counted again."""

MOST_LOOKS = 24
"""Number of looks at a plate that are remembered."""

_CROSS_SIGMA = 0.012  # of the range: the heading
_LEAST_SIGMA_MM = 10.0
_DRIFT_MM = 12.0  # of the odometry, from look to look
_SURE_MISSES = 4
_BASE_MM = 240.0  # looks that are nearer to each other do not show how far away a thing is
_RIM = 8.0  # pixels: a plate that is so near to the rim of an image need not be found
_FASTEST_MM_S, _FASTEST_DEG_S = 800.0, 100.0
_SLACK_MM, _SLACK_DEG = 20.0, 1.5

Floats = NDArray[np.float64]


@dataclass(slots=True, kw_only=True, eq=False)
class Track:
    """A candidate for a plate. Mutable: its place, and what was seen of it.

    Attributes:
        place, covariance: its middle, (2,) in mm, and (2, 2).
        looks: the newest looks assigned to it, the oldest first.
        origins, places: the robot's place at each of these looks, and the plate's by it, in mm.
        count, evidence: the number of all looks, and the sum of their scores.
        misses: number of images that should have shown it, and did not.
        counted: it is a plate, and was reported.
        door: its door in the map, if known.
    """

    place: Floats
    covariance: Floats
    looks: deque[Seen] = field(default_factory=partial(deque, maxlen=MOST_LOOKS))
    origins: deque[Floats] = field(default_factory=partial(deque, maxlen=MOST_LOOKS))
    places: deque[Floats] = field(default_factory=partial(deque, maxlen=MOST_LOOKS))
    count: int = 0
    evidence: float = 0.0
    misses: int = 0
    counted: bool = False
    door: str | None = None

    @property
    def hits(self) -> float:
        """Part of the images that should show it in which it was found."""
        return self.count / (self.count + self.misses)

    @property
    def drift(self) -> float:
        """Apparent motion of the candidate with the robot, as a part of the robot's way.

        It is about 0 for a plate, and more for what is of another size, and so not where it seems to be. The
        median over pairs of looks makes it robust to one jump of the position between them.
        """
        origins, places = np.array(self.origins), np.array(self.places)
        ways, moves = origins[:, None] - origins[None], places[:, None] - places[None]
        squared = (ways**2).sum(axis=2)
        far = squared >= _BASE_MM**2
        return float(np.median((ways * moves).sum(axis=2)[far] / squared[far])) if far.any() else 0.0

    @property
    def rise_mm(self) -> float:
        """Height of its middle above the camera, by all looks."""
        return float(np.median([look.rise_mm for look in self.looks]))

    @classmethod
    def begun(cls, seen: Seen) -> Track:
        """Begin a track with one look."""
        track = cls(place=np.array(seen.place), covariance=_covariance(seen))
        track._note(seen)
        return track

    def take(self, seen: Seen) -> None:
        """Take in one more look: a step of a Kalman filter of a place that hardly moves."""
        noise = _covariance(seen)
        prior = self.covariance + np.eye(2) * _DRIFT_MM**2
        gain = prior @ np.linalg.inv(prior + noise)
        self.place = self.place + gain @ (np.array(seen.place) - self.place)
        self.covariance = (np.eye(2) - gain) @ prior
        self._note(seen)

    def moved(self, rotation: Floats, here: Floats, there: Floats) -> None:
        """Turn all places about `here`, and move them so that `here` becomes `there`."""

        def at(place: Floats) -> Floats:
            return np.asarray(there + rotation @ (place - here))

        self.place, self.covariance = at(self.place), rotation @ self.covariance @ rotation.T
        self.origins = deque(map(at, self.origins), maxlen=MOST_LOOKS)
        self.places = deque(map(at, self.places), maxlen=MOST_LOOKS)

    def _note(self, seen: Seen) -> None:
        self.count += 1
        self.evidence += seen.score
        self.looks.append(seen)
        self.origins.append(np.array([seen.robot.x_mm, seen.robot.y_mm]))
        self.places.append(np.array(seen.place))


class PlateTracks:
    """All that may be plates near the robot. Mutable."""

    def __init__(self, camera: LevelCamera) -> None:
        """Begin with none."""
        self._camera = camera
        self._tracks: list[Track] = []
        self._last: tuple[int, Pose] | None = None

    @property
    def tracks(self) -> tuple[Track, ...]:
        """All tracks, the oldest first."""
        return tuple(self._tracks)

    def see(self, t_ns: int, robot: Pose, seen: Sequence[Seen]) -> tuple[Track, ...]:
        """Take in what is in an image; gives the tracks of it, in its order."""
        self.go(t_ns, robot)
        free = list(self._tracks)
        found: list[Track] = []
        for look in seen:
            track = _nearest(look, free)
            if track is None:
                track = Track.begun(look)
                self._tracks.append(track)
            else:
                free.remove(track)
                track.take(look)
            found.append(track)
        for track in free:
            if self.is_in_view(track):
                track.misses += 1
        self._tracks = [track for track in self._tracks if _is_worth_keeping(track, robot)]
        return tuple(found)

    def go(self, t_ns: int, robot: Pose) -> None:
        """Record that the robot is there now. If its position was corrected, all places move with it."""
        last, self._last = self._last, (t_ns, robot)
        if last is None:
            return
        passed_s = max(t_ns - last[0], 0) / 1e9
        before = last[1]
        turned = math.remainder(robot.heading_deg - before.heading_deg, 360.0)
        way = math.hypot(robot.x_mm - before.x_mm, robot.y_mm - before.y_mm)
        if (
            way <= _FASTEST_MM_S * passed_s + _SLACK_MM
            and abs(turned) <= _FASTEST_DEG_S * passed_s + _SLACK_DEG
        ):
            return
        sine, cosine = math.sin(math.radians(turned)), math.cos(math.radians(turned))
        rotation = np.array([[cosine, -sine], [sine, cosine]])
        here, there = np.array([before.x_mm, before.y_mm]), np.array([robot.x_mm, robot.y_mm])
        for track in self._tracks:
            track.moved(rotation, here, there)

    def is_in_view(self, track: Track) -> bool:
        """Return True if all of a plate, faced, would be in the newest image."""
        if self._last is None:
            return False
        robot = self._last[1]
        axis = math.radians(robot.heading_deg + self._camera.yaw_deg)
        dx, dy = (track.place - (robot.x_mm, robot.y_mm)).tolist()
        depth, right = -math.sin(axis) * dx + math.cos(axis) * dy, math.cos(axis) * dx + math.sin(axis) * dy
        if depth <= PLATE_WIDTH_MM:
            return False
        half = self._camera.focal * (abs(right) + PLATE_WIDTH_MM / 2.0) / depth
        return bool(half < self._camera.columns / 2.0 - _RIM)


def _covariance(seen: Seen) -> Floats:
    """Return the covariance of the place by one look."""
    along = _LEAST_SIGMA_MM + DEPTH_SIGMA * seen.range_mm
    cross = _LEAST_SIGMA_MM + _CROSS_SIGMA * seen.range_mm
    x, y = seen.ray
    ray, across = np.array([x, y]), np.array([y, -x])
    return np.asarray(along**2 * np.outer(ray, ray) + cross**2 * np.outer(across, across))


def _nearest(look: Seen, tracks: Sequence[Track]) -> Track | None:
    """Return the track to which a look belongs."""
    x, y = look.ray
    near: list[tuple[float, Track]] = []
    for track in tracks:
        dx, dy = (track.place - look.place).tolist()
        along, cross = abs(x * dx + y * dy), abs(y * dx - x * dy)
        if cross < SAME_MM and along < SAME_DEPTHS * look.range_mm + SAME_MM / 2.0:
            near.append((math.hypot(along / 2.0, cross), track))
    return min(near, key=lambda one: one[0])[1] if near else None


def _is_worth_keeping(track: Track, robot: Pose) -> bool:
    away = math.hypot(*(track.place - (robot.x_mm, robot.y_mm)).tolist())
    missing = track.misses >= _SURE_MISSES and track.misses > 2 * track.count
    return away < FORGET_MM and (track.counted or not missing)
