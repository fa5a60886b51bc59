"""A building's state in one run: its open doors, its broken lights, its people.

A scenery is plain data for the world, the sensors and the cameras. `colony.sim.hazards.hazards.draw` creates
it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.stickrep.geometry import Point, direction
from colony.nav.maps.stickrep.model import Pose

PERSON_RADIUS_MM = 250.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CorridorTrack:
    """The centerline of a corridor: from (x_mm, y_mm), `length_mm` long, toward `heading_deg`.

    The corridor is free for `half_width_mm` to either side.
    """

    x_mm: float
    y_mm: float
    heading_deg: float
    length_mm: float
    half_width_mm: float

    def point_at(self, along_mm: float, aside_mm: float = 0.0) -> Point:
        """Return the point `along_mm` along the line and `aside_mm` to its left."""
        unit = direction(self.heading_deg)
        x = self.x_mm + along_mm * unit.x - aside_mm * unit.y
        return Point(x, self.y_mm + along_mm * unit.y + aside_mm * unit.x)

    def coordinates(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Return the distance of a point along the line, and to the left of it."""
        unit = direction(self.heading_deg)
        dx, dy = x_mm - self.x_mm, y_mm - self.y_mm
        return dx * unit.x + dy * unit.y, dy * unit.x - dx * unit.y

    def joint(self, along_mm: float) -> ExpansionJoint:
        """Return an expansion joint across the corridor."""
        left, right = (
            self.point_at(along_mm, self.half_width_mm),
            self.point_at(along_mm, -self.half_width_mm),
        )
        return ExpansionJoint(x0_mm=left.x, y0_mm=left.y, x1_mm=right.x, y1_mm=right.y)


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenDoor:
    """An open door: edge number `edge` of the map, its leaf or leaves turned into the room by `angle_deg`."""

    edge: int
    angle_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Person:
    """A person who walks up and down a corridor.

    Attributes:
        track: the corridor.
        along_mm: initial position along the track.
        offset_mm: preferred offset to the left of the centerline, in the direction of the track.
        forward: True if the person first walks along the track, False against it.
        speed_mm_s: walking speed.
    """

    track: CorridorTrack
    along_mm: float
    offset_mm: float
    forward: bool
    speed_mm_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpansionJoint:
    """A metal expansion joint in the floor across a corridor, given by its ends in mm."""

    x0_mm: float
    y0_mm: float
    x1_mm: float
    y1_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelSlip:
    """The slip of wheels on expansion joints.

    It has the probability of a slip on a crossing, the standard deviation of the robot's turn, and the range
    of the length in mm by which the wheels spin without moving the robot.
    """

    probability: float
    turn_deg: float
    min_mm: float
    max_mm: float


NO_SLIP = WheelSlip(probability=0.0, turn_deg=0.0, min_mm=0.0, max_mm=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class CeilingLight:
    """A ceiling light, 0.6 m long along its corridor and 1.2 m wide across it.

    `heading_deg` is the direction of the corridor; `brightness` is 1, less for a dim light, and 0 for a
    light that is out.
    """

    x_mm: float
    y_mm: float
    heading_deg: float
    brightness: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SunBand:
    """A sunlit rectangle of the ceiling.

    It has its center, the heading of its length, and its excess brightness in gray levels.
    """

    x_mm: float
    y_mm: float
    heading_deg: float
    length_mm: float
    width_mm: float
    level: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Poster:
    """A poster on edge number `edge` of the map.

    It begins `start_mm` along the edge, and its center is `center_mm` above the floor. `kind` is its index
    in `colony.sim.cameras.atlas`.
    """

    edge: int
    start_mm: float
    center_mm: float
    kind: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Extinguisher:
    """A fire extinguisher with a sign above it, `along_mm` along edge number `edge` of the map."""

    edge: int
    along_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CompassDisturbance:
    """The disturbance of a compass: a random field of at most `max_deg` in either direction.

    Its values at the corners of a grid, `spacing_mm` apart, are drawn from `seed` and interpolated smoothly.
    """

    seed: int = 0
    max_deg: float = 0.0
    spacing_mm: float = 3000.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scenery:
    """A building in one run.

    Attributes:
        seed: seed of the random events during a run: slips, cross-talk, people.
        walls: (n, 4) float64, read-only: x0, y0, x1, y1 in mm of all solid, static segments.
        silent: (n,) bool, read-only: True for walls that neither sonar nor infrared detects.
        doors: the open doors.
        glass: the edges of the map that are silent.
        lights, sun: the lights and the sunlit parts of the ceiling.
        people: the people in the corridors.
        joints, slip: the expansion joints of the floor, and the slip of wheels on them.
        cross_talk: the probability that a sonar reading is false.
        encoder_scale: scale factor of both wheels, in addition to their own errors.
        compass_disturbance: the disturbance of the compass.
        posters, extinguishers: objects on walls and doors, visible to cameras.
        holes: the holes in the floor: polygons, (n, 2) in mm each.
        docks: the poses of robots that stand at charging docks.
        outlines: True if the walls are outlines of solid things on their left, which are seen from the right
            alone.
    """

    seed: int
    walls: NDArray[np.float64]
    silent: NDArray[np.bool_]
    doors: tuple[OpenDoor, ...] = ()
    glass: tuple[int, ...] = ()
    lights: tuple[CeilingLight, ...] = ()
    sun: tuple[SunBand, ...] = ()
    people: tuple[Person, ...] = ()
    joints: tuple[ExpansionJoint, ...] = ()
    slip: WheelSlip = NO_SLIP
    cross_talk: float = 0.0
    encoder_scale: float = 1.0
    compass_disturbance: CompassDisturbance = CompassDisturbance()
    posters: tuple[Poster, ...] = ()
    extinguishers: tuple[Extinguisher, ...] = ()
    holes: tuple[NDArray[np.float64], ...] = ()
    docks: tuple[Pose, ...] = ()
    outlines: bool = False


def bare_scenery(walls: NDArray[np.float64], *, seed: int = 0, outlines: bool = False) -> Scenery:
    """Return a scenery with walls, (n, 4) in mm, which may be outlines, and nothing else."""
    return Scenery(seed=seed, walls=walls, silent=np.zeros(len(walls), dtype=np.bool_), outlines=outlines)
