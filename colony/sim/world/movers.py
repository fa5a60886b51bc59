"""People who walk between random free places of a map, and free places for robots: worlds with company.

Each person walks straight up and down between two places that are drawn from the seed, as people walk up and
down corridors (`people.py`): they step aside for robots as far as the room beside the way allows, or stop, or
turn around; they never walk through walls, and they ignore each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from colony.nav.maps.free_space import FreeSpace, NoRoomError, Place
from colony.sim.hazards.scenery import PERSON_RADIUS_MM, CorridorTrack, Person, Scenery

WALK_MM_S = (600.0, 1400.0)
"""The range of walking speeds."""

_HALF_WIDTHS_MM = (1_500.0, 1_100.0, 800.0, 500.0, 320.0)  # of the ways, as wide as the walls allow
_START_MM = 1_000.0  # distance between the hulls of robots at their starts
_TRIES = 25
_PEOPLE, _ROBOTS = 1, 2  # the random streams


def with_movers(
    scenery: Scenery, space: Callable[[], FreeSpace], start: Place, count: int, *, seed: int
) -> Scenery:
    """Return a scenery with more people: see `movers`. The space is needed only if there are any."""
    if not count:
        return scenery
    return replace(scenery, people=(*scenery.people, *movers(space(), start, count, seed=seed)))


def movers(space: FreeSpace, start: Place, count: int, *, seed: int) -> tuple[Person, ...]:
    """Return people who walk between random free places, each with a random stream of its own.

    Args:
        space: the free space of the map.
        start: a place in the free space; the others can be reached from there.
        count: the number of people.
        seed: the seed, at least 0.

    Raises:
        NoRoomError: there is no room for people around `start`.
    """
    return tuple(_mover(space, start, _stream(seed, _PEOPLE, number)) for number in range(count))


def _mover(space: FreeSpace, start: Place, rng: np.random.Generator) -> Person:
    place, end = space.random_leg(start, _HALF_WIDTHS_MM[-1], rng)
    half_width = next(half for half in _HALF_WIDTHS_MM if space.is_free(place, end, half))
    heading = math.degrees(math.atan2(place[0] - end[0], end[1] - place[1])) % 360.0
    track = CorridorTrack(
        x_mm=place[0],
        y_mm=place[1],
        heading_deg=heading,
        length_mm=math.dist(place, end),
        half_width_mm=half_width,
    )
    along, aside, speed = rng.random(3).tolist()
    return Person(
        track=track,
        along_mm=along * track.length_mm,
        offset_mm=(2.0 * aside - 1.0) * max(half_width - PERSON_RADIUS_MM, 0.0) / 2.0,
        forward=bool(rng.random() < 0.5),
        speed_mm_s=WALK_MM_S[0] + speed * (WALK_MM_S[1] - WALK_MM_S[0]),
    )


def free_pose(
    space: FreeSpace,
    start: Place,
    radius_mm: float,
    taken: list[tuple[Place, float]],
    *,
    number: int,
    seed: int,
) -> tuple[float, float, float]:
    """Return a random free pose of a robot, x and y in mm and the heading in degrees.

    Args:
        space: the free space of the map.
        start: a place in the free space; the pose can be reached from there.
        radius_mm: the radius of the robot.
        taken: the places of other robots and their radii; the pose is at least a meter from their hulls.
        number: the number of the robot, for its random stream.
        seed: the seed, at least 0.

    Raises:
        NoRoomError: there is no free place for the robot.
    """
    rng = _stream(seed, _ROBOTS, number)
    for _ in range(_TRIES):
        _, place = space.random_leg(start, radius_mm, rng)
        if all(math.dist(place, at) >= radius_mm + radius + _START_MM for at, radius in taken):
            return *place, float(rng.uniform(0.0, 360.0))
    raise NoRoomError(f"there is no free place for a robot with a radius of {radius_mm:.0f} mm")


def _stream(seed: int, kind: int, number: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(kind, number)))
