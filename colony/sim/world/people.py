"""People who walk up and down the corridors.

A person walks along a line beside the centerline of a corridor and turns around at its end. If a robot is on
the path, the person either steps aside and passes, or (at random) stops and watches it for up to fifteen
seconds before stepping aside. Without room to pass, a person always stops, and then turns around. A person
that has stopped for a robot does not stop again for a minute.

People never walk into a robot: they take no step that brings them nearer than `_BERTH_MM` to a hull. So a
collision with a person is always caused by the robot. People ignore each other.

Coordinates are relative to the person's track: s along it, v to the left of it, both in mm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.sim.chance import PEOPLE, uniform
from colony.sim.compiled import Floats, Floats2, called, inlined
from colony.sim.hazards.scenery import PERSON_RADIUS_MM, Person

LONGEST_STOP_S = 15.0

_STOPPING = 0.4  # fraction of encounters in which the person stops
_NOTICE_MM = 2600.0  # distance at which a person notices a robot ahead, center to center
_HALT_MM = 1100.0  # distance from a robot at which a person stops
_BERTH_MM = 60.0
_PASSING_MM = 850.0  # preferred lateral distance for passing a robot, center to center
_TIGHT_MM = 740.0  # minimum lateral distance for passing a robot
_WIDE_MM = 1600.0  # lateral distance beyond which a passing person ignores a robot
_SIDE_MM_S = 500.0
_COOLDOWN_S = 60.0
_BLOCKED_S = 4.0  # time after which a blocked person turns around
_WALL_MM = 50.0
_START_MM = 2000.0

X, Y, S, V, FORWARD, SPEED, PREFERRED_V, X0, Y0, U, W, LENGTH, LIMIT, ACTION, WAIT, ENCOUNTERS, COOLDOWN = (
    range(17)
)
"""Columns of a person: position in the world and on the track, direction (1 or -1), walking speed, preferred
offset; start, unit vector, length and largest offset of the track; action, its remaining seconds, number of
encounters with robots, and seconds until the person may stop for a robot again."""

_WALKS, _STANDS, _PASSES = 0.0, 1.0, 2.0


class Crowd(NamedTuple):
    """All people, one row each, with their radius; `seed` determines their decisions."""

    people: Floats2
    radius: float
    seed: int


def crowd_of(people: Sequence[Person], *, seed: int) -> Crowd:
    """Return people at their initial positions."""
    rows = np.zeros((len(people), 17))
    for row, person in zip(rows, people, strict=True):
        track = person.track
        angle = math.radians(track.heading_deg)
        limit = max(track.half_width_mm - PERSON_RADIUS_MM - _WALL_MM, 0.0)
        row[[X0, Y0, U, W, LENGTH, LIMIT]] = (
            track.x_mm, track.y_mm, -math.sin(angle), math.cos(angle), track.length_mm, limit,
        )  # fmt: skip
        row[[S, SPEED, FORWARD]] = person.along_mm, person.speed_mm_s, 1.0 if person.forward else -1.0
        row[V] = row[PREFERRED_V] = min(max(person.offset_mm, -limit), limit)
        _update_position(row)
    return Crowd(people=rows, radius=PERSON_RADIUS_MM, seed=seed)


def make_way(crowd: Crowd, poses: NDArray[np.float64], *, robot: int | None = None) -> None:
    """Move people away from robots that are placed on their tracks.

    A person moves to the first position on the track that is far enough from all robots, or else to the
    farthest one.

    Args:
        crowd: the people; changed.
        poses: (robots, 3), the poses of all robots.
        robot: the robot that is placed; None for all.
    """
    placed = poses if robot is None else poses[robot : robot + 1]
    for row in crowd.people:
        if _nearest(row, placed) < _START_MM:
            start = row[S]
            candidates = []
            for step in range(max(1, int(row[LENGTH] / 500.0))):
                row[S] = (start + 500.0 * step) % max(row[LENGTH], 1.0)
                _update_position(row)
                candidates.append((min(_nearest(row, poses), _START_MM), -step, row[S]))
            row[S] = max(candidates)[2]
            _update_position(row)


def _nearest(row: Floats, poses: NDArray[np.float64]) -> float:
    return float(np.hypot(poses[:, 0] - row[X], poses[:, 1] - row[Y]).min())


def _update_position(row: Floats) -> None:
    """Set the position of a person from the coordinates on the track."""
    row[X] = row[X0] + row[S] * row[U] - row[V] * row[W]
    row[Y] = row[Y0] + row[S] * row[W] + row[V] * row[U]


@inlined
def _passing_v(row: Floats, robot_v: float) -> float:
    """Return v for passing a robot at offset `robot_v`; nan if the corridor is too narrow."""
    left = min(robot_v + _PASSING_MM, row[LIMIT])
    right = max(robot_v - _PASSING_MM, -row[LIMIT])
    left_fits, right_fits = left - robot_v >= _TIGHT_MM, robot_v - right >= _TIGHT_MM
    nearer = left if abs(left - row[V]) <= abs(right - row[V]) else right
    fitting = left if left_fits else (right if right_fits else math.nan)
    return nearer if left_fits and right_fits else fitting


@inlined
def _turn_around(row: Floats) -> None:
    row[ACTION], row[FORWARD] = _WALKS, -row[FORWARD]


@inlined
def _decide(row: Floats, person: int, seed: int, passing_v: float) -> None:
    """Decide a person's action on encountering a robot."""
    event = int(row[ENCOUNTERS]) + 1_000_000 * person
    row[ENCOUNTERS] += 1.0
    is_blocked = math.isnan(passing_v)
    if row[COOLDOWN] <= 0.0 and (is_blocked or uniform(seed, PEOPLE, event, 0) < _STOPPING):
        row[ACTION], row[WAIT] = _STANDS, 1.0 + (LONGEST_STOP_S - 1.0) * uniform(seed, PEOPLE, event, 1)
        row[COOLDOWN] = _COOLDOWN_S
    elif is_blocked:
        _turn_around(row)
    else:
        row[ACTION], row[WAIT] = _PASSES, _BLOCKED_S


@inlined
def _robot_ahead(row: Floats, poses: Floats2) -> tuple[float, float]:
    """Return the distance to the nearest robot on a person's path (infinity for none), and the robot's v."""
    nearest, robot_v = math.inf, 0.0
    path_half_width = _PASSING_MM if row[ACTION] == _WALKS else _WIDE_MM
    for robot in range(poses.shape[0]):
        dx, dy = poses[robot, 0] - row[X0], poses[robot, 1] - row[Y0]
        ahead = (dx * row[U] + dy * row[W] - row[S]) * row[FORWARD]
        v = dy * row[U] - dx * row[W]
        if ahead > -200.0 and ahead < min(_NOTICE_MM, nearest) and abs(v - row[V]) < path_half_width:
            nearest, robot_v = max(ahead, 0.0), v
    return nearest, robot_v


@inlined
def _is_allowed(row: Floats, poses: Floats2, berths: Floats, ds: float, dv: float) -> bool:
    """Return True if a step keeps clear of all robots, or leads away from them."""
    is_allowed = True
    for robot in range(poses.shape[0]):
        dx, dy = row[X] - poses[robot, 0], row[Y] - poses[robot, 1]
        nx, ny = dx + ds * row[U] - dv * row[W], dy + ds * row[W] + dv * row[U]
        after, berth = nx * nx + ny * ny, berths[robot]
        is_allowed &= (after >= berth * berth) | (after >= dx * dx + dy * dy)
    return is_allowed


@inlined
def _step(row: Floats, poses: Floats2, berths: Floats, wanted_v: float, speed: float, dt: float) -> None:
    """Walk for `dt` seconds toward `wanted_v`, as far as robots allow; turn around at the track's end."""
    ds = row[FORWARD] * speed * dt
    dv = min(max(wanted_v - row[V], -_SIDE_MM_S * dt), _SIDE_MM_S * dt)
    if row[S] + ds < 0.0 or row[S] + ds > row[LENGTH]:
        row[FORWARD] = -row[FORWARD]
        ds = 0.0
    if not _is_allowed(row, poses, berths, ds, dv):
        ds = 0.0
    if not _is_allowed(row, poses, berths, ds, dv):
        dv = 0.0
    row[S] += ds
    row[V] += dv
    row[X] = row[X0] + row[S] * row[U] - row[V] * row[W]
    row[Y] = row[Y0] + row[S] * row[W] + row[V] * row[U]


@called
def walk(crowd: Crowd, poses: Floats2, radii: Floats, dt: float) -> None:
    """Let all people walk for `dt` seconds among robots with hulls of these radii at `poses`."""
    berths = radii + crowd.radius + _BERTH_MM
    for person in range(crowd.people.shape[0]):
        row = crowd.people[person]
        ahead, robot_v = _robot_ahead(row, poses)
        passing_v = _passing_v(row, robot_v)
        wanted_v, speed = row[PREFERRED_V], row[SPEED]
        row[COOLDOWN] -= dt
        if ahead == math.inf:
            row[ACTION] = _WALKS
        else:
            if row[ACTION] == _WALKS:
                _decide(row, person, crowd.seed, passing_v)
            row[WAIT] -= dt
            if row[WAIT] < 0.0 and (row[ACTION] == _PASSES or math.isnan(passing_v)):
                _turn_around(row)
            elif row[WAIT] < 0.0:
                row[ACTION], row[WAIT] = _PASSES, _BLOCKED_S
            if row[ACTION] == _STANDS:
                wanted_v, speed = row[V], 0.0
            elif row[ACTION] == _PASSES:
                wanted_v = row[V] if math.isnan(passing_v) else passing_v
                speed = 0.0 if ahead < _HALT_MM and abs(robot_v - row[V]) < _TIGHT_MM - 1.0 else speed
        _step(row, poses, berths, wanted_v, speed, dt)
