"""The parts of a building that hazards may affect: doors and the rooms behind them, corridors, lights.

Nothing here is random. The wings differ in the width of their corridors: where corridors of different widths
meet, two wings meet, and the floor has an expansion joint.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.corridors import Corridor, corridors_of, turning_spaces_of
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.maps.walls import lights_of, walls_of
from colony.sim.cameras.rooms import Room, room_behind
from colony.sim.hazards.scenery import PERSON_RADIUS_MM, CeilingLight, CorridorTrack, ExpansionJoint

_WING_MM = 300.0  # maximum difference of corridor widths within a wing
_TURN_MM = 800.0  # distance from the end of a corridor at which people turn around
_MIN_WALK_MM = 3000.0
_MIN_MOUTH_MM = 1000.0  # minimum distance of a joint from the end of a corridor
_SHOULDER_MM = 60.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Premises:
    """A floor without hazards.

    Attributes:
        walls: (n, 4) float64, the edges of the map in its order, in mm.
        glass: the edges that are glass.
        rooms: the rooms behind the doors that can open, by edge.
        lights: all lights, switched on.
        tracks: the corridors.
        walks: the part of each corridor where people can walk; None if there is none.
        wing_joints: the expansion joints where corridors of different wings meet.
    """

    walls: NDArray[np.float64]
    glass: tuple[int, ...]
    rooms: Mapping[int, Room]
    lights: tuple[CeilingLight, ...]
    tracks: tuple[CorridorTrack, ...]
    walks: tuple[CorridorTrack | None, ...]
    wing_joints: tuple[ExpansionJoint, ...]


@lru_cache(maxsize=16)
def premises_of(floor: Map) -> Premises:
    """Return the premises of a floor; cached, because experiments use the same floors repeatedly."""
    walls, corridors = walls_of(floor), corridors_of(floor)
    tracks = tuple(_track(corridor) for corridor in corridors)
    rooms = {
        edge: room_behind(walls.segments, edge)
        for edge, (kind, is_glass) in enumerate(zip(walls.kinds, walls.glass, strict=True))
        if kind is EdgeKind.DOOR and not is_glass
    }
    return Premises(
        walls=walls.segments,
        glass=tuple(edge for edge, is_glass in enumerate(walls.glass) if is_glass),
        rooms={edge: room for edge, room in rooms.items() if room is not None},
        lights=tuple(_light(x, y, tracks) for x, y in lights_of(floor).tolist()),
        tracks=tracks,
        walks=tuple(_walk(track, walls.segments) for track in tracks),
        wing_joints=tuple(_wing_joints(corridors, tracks)),
    )


def _track(corridor: Corridor) -> CorridorTrack:
    return CorridorTrack(
        x_mm=corridor.start.x,
        y_mm=corridor.start.y,
        heading_deg=corridor.heading_deg,
        length_mm=corridor.length_mm,
        half_width_mm=corridor.width_mm / 2,
    )


def _light(x: float, y: float, tracks: tuple[CorridorTrack, ...]) -> CeilingLight:
    """Return a light, along the corridor whose centerline is nearest."""
    nearest = min(tracks, key=lambda track: round(_distance(track, x, y)), default=None)
    return CeilingLight(x_mm=x, y_mm=y, heading_deg=0.0 if nearest is None else nearest.heading_deg)


def _distance(track: CorridorTrack, x: float, y: float) -> float:
    along, aside = track.coordinates(x, y)
    return math.hypot(max(-along, along - track.length_mm, 0.0), aside)


def _walk(track: CorridorTrack, walls: NDArray[np.float64]) -> CorridorTrack | None:
    """Return the part of a corridor where people walk: without its ends, as wide as the walls allow."""
    length = track.length_mm - 2 * _TURN_MM
    if length < _MIN_WALK_MM:
        return None
    start = track.point_at(_TURN_MM)
    walk = CorridorTrack(
        x_mm=start.x, y_mm=start.y, heading_deg=track.heading_deg, length_mm=length, half_width_mm=0.0
    )
    half = min(track.half_width_mm, _clearance(walk, walls))
    if half < PERSON_RADIUS_MM + _SHOULDER_MM:
        return None
    return CorridorTrack(
        x_mm=start.x, y_mm=start.y, heading_deg=track.heading_deg, length_mm=length, half_width_mm=half
    )


def _clearance(track: CorridorTrack, walls: NDArray[np.float64]) -> float:
    """Return the minimum lateral distance of a wall from a track that is longer by a person at both ends."""
    clearance = math.inf
    low, high = -PERSON_RADIUS_MM, track.length_mm + PERSON_RADIUS_MM
    for x0, y0, x1, y1 in walls.tolist():
        (s0, v0), (s1, v1) = track.coordinates(x0, y0), track.coordinates(x1, y1)
        if max(s0, s1) < low or min(s0, s1) > high:
            continue
        if s0 != s1:
            slope, ends = (v1 - v0) / (s1 - s0), [min(max(s, low), high) for s in (s0, s1)]
            v0, v1 = (v0 + (s - s0) * slope for s in ends)
        clearance = min(clearance, 0.0 if v0 * v1 <= 0.0 else min(abs(v0), abs(v1)))
    return clearance


def _wing_joints(corridors: tuple[Corridor, ...], tracks: tuple[CorridorTrack, ...]) -> list[ExpansionJoint]:
    """Return a joint across the narrower of two corridors of different wings, at each of its mouths."""
    joints: list[ExpansionJoint] = []
    for space in turning_spaces_of(corridors):
        narrow_index, wide_index = sorted(space.corridors, key=lambda c: corridors[c].width_mm)
        narrow, wide = corridors[narrow_index], corridors[wide_index]
        if wide.width_mm - narrow.width_mm > _WING_MM:
            center = narrow.along(*space.center)
            low, high = _MIN_MOUTH_MM, narrow.length_mm - _MIN_MOUTH_MM
            mouths = (center - wide.width_mm / 2, center + wide.width_mm / 2)
            joints += [tracks[narrow_index].joint(mouth) for mouth in mouths if low < mouth < high]
    return joints
