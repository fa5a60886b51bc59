"""The local mapper of the thesis: a client that corrects RServer's heading by the sonars (section 5.5).

It corrects only the heading, once for every three lights, assuming that the hallway has the direction of the
goal. So it never corrects the heading in a hallway with fewer lights. The pose estimator
(`colony/nav/pose/estimate.py`) tracks the robot in the map scan by scan, everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import Any

import numpy as np

from colony.nav.mapping.himm import HimmMap, HimmParameters, LocalPose
from colony.nav.mapping.local_map import lines_in
from colony.nav.mapping.wall_matching import wrap_deg
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.echoes import rome_sonars
from colony.nav.shared import (
    GOAL_DIRECTION,
    GOAL_DISTANCE,
    LIGHT_DETECTED,
    START_MAP,
    try_adjust_position,
    try_ask,
    try_wait,
)
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data, proximity, robot
from colony.runtime.library.proximity import SonarReading
from colony.runtime.library.robot import Position

LIGHTS_PER_MAP = 3
"""Number of lights per map: a map extends from its first light to its third, where the next map begins."""

PERIOD_S = 0.1
"""Seconds between two scans."""


def local_mapper() -> Script:
    """Correct RServer's heading in the light-tracking mode, forever.

    Each correction comes from the lines in a local map that spans three lights.
    """
    himm = HimmParameters(sonars=rome_sonars())
    for name in (START_MAP, LIGHT_DETECTED):
        yield from do("DServer", data.create_semaphore(name, 0))
    while True:
        yield from do("DServer", data.wait(START_MAP))
        while (yield from _map_segment(himm)):
            pass


def _map_segment(himm: HimmParameters) -> Generator[Step, Any, bool]:
    """Build maps along a segment up to its last light; return True if the next segment begins before that."""
    while (yield from try_wait(LIGHT_DETECTED, 0.0)):  # a light of the previous segment
        pass
    lights_left = int((yield from do("DServer", data.get(GOAL_DISTANCE, type=float))))
    local_map, origin, lights, last_scan_ns = HimmMap(himm), None, 0, -1
    while lights_left > 0:
        yield from sleep(PERIOD_S)
        if (yield from try_wait(START_MAP, 0.0)):
            return True
        scan, base_position = yield from _scan_and_position()
        if (
            origin is not None
            and scan is not None
            and base_position is not None
            and scan.t_ns != last_scan_ns
        ):
            last_scan_ns = scan.t_ns
            local_map.mark(local_pose(origin, _pose(base_position)), np.array(scan.ranges))
        if not (yield from try_wait(LIGHT_DETECTED, 0.0)):
            continue
        lights, lights_left = lights + 1, lights_left - 1
        if origin is not None and lights == LIGHTS_PER_MAP:
            yield from _correct_heading(local_map, origin)
        if lights in (1, LIGHTS_PER_MAP):
            base_position = yield from try_ask("RServer", robot.position())
            origin, lights = None if base_position is None else _pose(base_position), 1
            local_map.clear()
    return False


def _correct_heading(local_map: HimmMap, origin: Pose) -> Generator[Step, Any, None]:
    """Turn RServer's heading so that the hallway in the map has the direction of the goal."""
    lines = lines_in(local_map.cells())
    if not lines:
        return
    goal = yield from do("DServer", data.get(GOAL_DIRECTION, type=float))
    measured = hallway_direction(origin.heading_deg + lines[0].angle_deg, goal)
    yield from try_adjust_position(0.0, 0.0, wrap_deg(goal - measured))


def _pose(base_position: Position) -> Pose:
    return Pose(base_position.x, base_position.y, base_position.heading)


def _scan_and_position() -> Generator[Step, Any, tuple[SonarReading | None, Position | None]]:
    """Return the newest scan, and the position right after it; each is None if unavailable."""
    scan = yield from try_ask("PServer", proximity.sonar())
    base_position = yield from try_ask("RServer", robot.position())
    return scan, base_position


def hallway_direction(orientation_deg: float, goal_deg: float) -> float:
    """Return the one of the two directions along a hallway that is nearer to the goal's direction.

    All angles are headings in the same frame. If both directions are 90 degrees off, the orientation itself
    is returned.

    Returns:
        `orientation_deg` or `orientation_deg` + 180, in (-180, 180].
    """
    forward_error = abs(wrap_deg(goal_deg - orientation_deg))
    reverse_error = abs(wrap_deg(goal_deg - orientation_deg - 180.0))
    return wrap_deg(orientation_deg if forward_error <= reverse_error else orientation_deg + 180.0)


def local_pose(origin: Pose, pose: Pose) -> LocalPose:
    """Return `pose` in the frame of `origin` (thesis section 5.5)."""
    heading = math.radians(origin.heading_deg)
    sine, cosine = math.sin(heading), math.cos(heading)
    dx, dy = pose.x_mm - origin.x_mm, pose.y_mm - origin.y_mm
    return LocalPose(
        ahead_mm=-dx * sine + dy * cosine,
        left_mm=-dx * cosine - dy * sine,
        heading_rad=math.radians(pose.heading_deg) - heading,
    )
