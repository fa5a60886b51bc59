"""People who walk up and down the corridors.

A person keeps to a line beside the middle of a corridor and turns around at its end. When a robot is in the
way they do, at random, one of two things: they step aside and pass, or they stop and look at it, for up to
fifteen seconds, and step aside then. If there is no room to pass they always stop, and then turn around. A
person who has stopped for a robot does not do so again for a minute.

They never walk into a robot: a step that would bring them nearer than `_BERTH_MM` to a hull is not taken. So
a robot that stands still is never touched; a collision with a person is always caused by the robot. People do
not mind each other.

Everything happens along the person's track: s along it, v to the left of it, both in mm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.sim.chance import PEOPLE, chance
from colony.sim.compiled import Floats, Floats2, compiled, inlined
from colony.sim.hazards.scenery import PERSON_RADIUS_MM, Person

LONGEST_STOP_S = 15.0

_STOPPING = 0.4  # the part of encounters in which the person stops
_NOTICE_MM = 2600.0  # from so far a person minds a robot ahead, middle to middle
_HALT_MM = 1100.0  # nearer than this to a robot they stop
_BERTH_MM = 60.0
_PASSING_MM = 850.0  # how far aside of a robot they like to pass, middle to middle, and what must do
_TIGHT_MM = 740.0
_WIDE_MM = 1600.0  # a person minds a robot until it is so far aside, or behind
_SIDE_MM_S = 500.0
_CALM_S = 60.0
_PATIENCE_S = 4.0  # a person who cannot get past for so long turns around
_WALL_MM = 50.0
_START_MM = 2000.0

X, Y, S, V, FORWARD, SPEED, HOME, X0, Y0, U, W, LENGTH, LIMIT, MOOD, WAIT, MEETINGS, CALM = range(17)
"""Columns of a person: the place, the same along and aside of the track, direction (1 or -1), walking speed
and the offset of choice; the track's start, unit vector and length, and how far aside of it they can walk;
what they do, for how many seconds still, how many robots they met, and until they stop for one again."""

_WALKS, _STANDS, _PASSES = 0.0, 1.0, 2.0


class Crowd(NamedTuple):
    """All people, one row each, and the hull of each; `seed` decides what they do."""

    places: Floats2
    radius: float
    seed: int


def crowd_of(people: Sequence[Person], *, seed: int) -> Crowd:
    """Return people where they begin."""
    places = np.zeros((len(people), 17))
    for row, person in zip(places, people, strict=True):
        track = person.track
        angle = math.radians(track.heading_deg)
        limit = max(track.half_width_mm - PERSON_RADIUS_MM - _WALL_MM, 0.0)
        row[[X0, Y0, U, W, LENGTH, LIMIT]] = (
            track.x_mm, track.y_mm, -math.sin(angle), math.cos(angle), track.length_mm, limit,
        )  # fmt: skip
        row[[S, SPEED, FORWARD]] = person.along_mm, person.speed_mm_s, 1.0 if person.forward else -1.0
        row[V] = row[HOME] = min(max(person.offset_mm, -limit), limit)
        _put(row)
    return Crowd(places=places, radius=PERSON_RADIUS_MM, seed=seed)


def make_way(crowd: Crowd, poses: NDArray[np.float64], *, of: int | None = None) -> None:
    """Move people who are in the way of robots that are put down along their track.

    A person without a place there that is far enough from all robots takes the farthest.

    Args:
        crowd: the people; changed.
        poses: (robots, 3), of all robots.
        of: only this robot is put down; None: all are.
    """
    put_down = poses if of is None else poses[of : of + 1]
    for row in crowd.places:
        if _nearest(row, put_down) < _START_MM:
            start = row[S]
            tried = []
            for step in range(max(1, int(row[LENGTH] / 500.0))):
                row[S] = (start + 500.0 * step) % max(row[LENGTH], 1.0)
                _put(row)
                tried.append((min(_nearest(row, poses), _START_MM), -step, row[S]))
            row[S] = max(tried)[2]
            _put(row)


def _nearest(row: Floats, poses: NDArray[np.float64]) -> float:
    return float(np.hypot(poses[:, 0] - row[X], poses[:, 1] - row[Y]).min())


def _put(row: Floats) -> None:
    """Set the place of a person to what it is along and aside of the track."""
    row[X] = row[X0] + row[S] * row[U] - row[V] * row[W]
    row[Y] = row[Y0] + row[S] * row[W] + row[V] * row[U]


@inlined
def _way_aside(row: Floats, robot_v: float) -> float:
    """Return v for passing a robot that is `robot_v` aside of the track; nan if there is no room."""
    left = min(robot_v + _PASSING_MM, row[LIMIT])
    right = max(robot_v - _PASSING_MM, -row[LIMIT])
    left_fits, right_fits = left - robot_v >= _TIGHT_MM, robot_v - right >= _TIGHT_MM
    nearer = left if abs(left - row[V]) <= abs(right - row[V]) else right
    one = left if left_fits else (right if right_fits else math.nan)
    return nearer if left_fits and right_fits else one


@inlined
def _turn_around(row: Floats) -> None:
    row[MOOD], row[FORWARD] = _WALKS, -row[FORWARD]


@inlined
def _decide(row: Floats, person: int, seed: int, aside: float) -> None:
    """Decide what a person does after meeting a robot."""
    event = int(row[MEETINGS]) + 1_000_000 * person
    row[MEETINGS] += 1.0
    no_room = math.isnan(aside)
    if row[CALM] <= 0.0 and (no_room or chance(seed, PEOPLE, event, 0) < _STOPPING):
        row[MOOD], row[WAIT] = _STANDS, 1.0 + (LONGEST_STOP_S - 1.0) * chance(seed, PEOPLE, event, 1)
        row[CALM] = _CALM_S
    elif no_room:
        _turn_around(row)
    else:
        row[MOOD], row[WAIT] = _PASSES, _PATIENCE_S


@inlined
def _ahead(row: Floats, poses: Floats2) -> tuple[float, float]:
    """Return how far ahead of a person the nearest robot in the way is (infinity: none), and its v."""
    nearest, its_v = math.inf, 0.0
    wide = _PASSING_MM if row[MOOD] == _WALKS else _WIDE_MM
    for robot in range(poses.shape[0]):
        dx, dy = poses[robot, 0] - row[X0], poses[robot, 1] - row[Y0]
        ahead = (dx * row[U] + dy * row[W] - row[S]) * row[FORWARD]
        v = dy * row[U] - dx * row[W]
        if ahead > -200.0 and ahead < min(_NOTICE_MM, nearest) and abs(v - row[V]) < wide:
            nearest, its_v = max(ahead, 0.0), v
    return nearest, its_v


@inlined
def _allowed(row: Floats, poses: Floats2, berth: float, ds: float, dv: float) -> bool:
    """Return True if a step keeps clear of all robots, or at least leads away from them."""
    allowed = True
    for robot in range(poses.shape[0]):
        dx, dy = row[X] - poses[robot, 0], row[Y] - poses[robot, 1]
        nx, ny = dx + ds * row[U] - dv * row[W], dy + ds * row[W] + dv * row[U]
        after = nx * nx + ny * ny
        allowed &= (after >= berth * berth) | (after >= dx * dx + dy * dy)
    return allowed


@inlined
def _step(row: Floats, poses: Floats2, berth: float, wanted_v: float, speed: float, dt: float) -> None:
    """Walk for `dt` seconds toward `wanted_v`, as far as robots allow, and turn where the track ends."""
    ds = row[FORWARD] * speed * dt
    dv = min(max(wanted_v - row[V], -_SIDE_MM_S * dt), _SIDE_MM_S * dt)
    if row[S] + ds < 0.0 or row[S] + ds > row[LENGTH]:
        row[FORWARD] = -row[FORWARD]
        ds = 0.0
    if not _allowed(row, poses, berth, ds, dv):
        ds = 0.0
    if not _allowed(row, poses, berth, ds, dv):
        dv = 0.0
    row[S] += ds
    row[V] += dv
    row[X] = row[X0] + row[S] * row[U] - row[V] * row[W]
    row[Y] = row[Y0] + row[S] * row[W] + row[V] * row[U]


@compiled
def walk(crowd: Crowd, poses: Floats2, hull: float, dt: float) -> None:
    """Let all people walk for `dt` seconds among robots of radius `hull` at `poses`."""
    berth = hull + crowd.radius + _BERTH_MM
    for person in range(crowd.places.shape[0]):
        row = crowd.places[person]
        ahead, robot_v = _ahead(row, poses)
        aside = _way_aside(row, robot_v)
        wanted_v, speed = row[HOME], row[SPEED]
        row[CALM] -= dt
        if ahead == math.inf:
            row[MOOD] = _WALKS
        else:
            if row[MOOD] == _WALKS:
                _decide(row, person, crowd.seed, aside)
            row[WAIT] -= dt
            if row[WAIT] < 0.0 and (row[MOOD] == _PASSES or math.isnan(aside)):
                _turn_around(row)
            elif row[WAIT] < 0.0:
                row[MOOD], row[WAIT] = _PASSES, _PATIENCE_S
            if row[MOOD] == _STANDS:
                wanted_v, speed = row[V], 0.0
            elif row[MOOD] == _PASSES:
                wanted_v = row[V] if math.isnan(aside) else aside
                speed = 0.0 if ahead < _HALT_MM and abs(robot_v - row[V]) < _TIGHT_MM - 1.0 else speed
        _step(row, poses, berth, wanted_v, speed, dt)
