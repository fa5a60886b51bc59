"""The local mapper: a client that keeps the robot's position at RServer right by what the sonars hear (thesis
section 5.5).

The thesis's own corrects the heading only, once for every three lights, against the direction of the goal,
and so not at all in a hallway of fewer lights. This one follows the robot through the map scan by scan,
everywhere, and corrects the position as well; `thesis=True` gives the other, to compare with.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, TypeVar

import numpy as np

from colony.nav.echoes import SonarModel
from colony.nav.himm import HimmMap, HimmSetting
from colony.nav.hough import lines_in
from colony.nav.local_map import local_pose
from colony.nav.orientation import directed, wrapped
from colony.nav.pose_tracker import Correction, PoseTracker, position_at
from colony.nav.shared import GOAL_DIRECTION, GOAL_DISTANCE, LIGHT_DETECTED, START_MAP
from colony.nav.stickrep import Pose
from colony.nav.walls import Walls
from colony.runtime.kit.errors import CallRefused, ConnectionProblem
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data, proximity, robot
from colony.runtime.library.ask import Ask
from colony.runtime.library.proximity import SonarReading
from colony.runtime.library.robot import Position

T = TypeVar("T")

LIGHTS_A_MAP = 3
"""A map begins below one light and ends below the second one after it, where the next map begins."""


def local_mapper(
    walls: Walls, *, period_s: float = 0.1, thesis: bool = False, sonar: SonarModel | None = None
) -> Script:
    """Correct RServer's position by what the sonars hear of the walls, for ever.

    While RServer or PServer is away, or has nothing to say, it waits.

    Args:
        walls: of the floor; the thesis's own does not look at them.
        period_s: from scan to scan.
        thesis: do as the thesis's local mapper does.
        sonar: what the sonars are believed to be like.
    """
    model = sonar or SonarModel()
    return _heading_by_lights(period_s, model) if thesis else _pose_by_walls(walls, period_s, model)


def _pose_by_walls(walls: Walls, period_s: float, model: SonarModel) -> Script:
    """Follow the robot through the map."""
    tracker = PoseTracker(walls, model)
    heard_ns = -1
    last: Position | None = None
    while True:
        yield from sleep(period_s)
        scan, where = yield from _scan_and_position()
        if scan is None or where is None or scan.t_ns == heard_ns:
            continue
        heard_ns = scan.t_ns
        correction = tracker.take(scan.ranges, position_at(scan.t_ns, where, last))
        last = where
        if correction.is_worth_telling and (yield from _adjusted(correction)):
            tracker.told(correction)
            dx, dy, turn = correction.x_mm, correction.y_mm, correction.heading_deg
            last = Position(x=where.x + dx, y=where.y + dy, heading=where.heading + turn, t_ns=where.t_ns)


def _heading_by_lights(period_s: float, model: SonarModel) -> Script:
    """Correct the heading in the ceiling-light tracking mode, by the lines in a map of every three lights."""
    himm = HimmSetting(full_range_mm=model.full_range_mm, ring_mm=model.ring_mm)
    for name in (START_MAP, LIGHT_DETECTED):
        yield from do("DServer", data.create_semaphore(name, 0))
    while True:
        yield from do("DServer", data.wait(START_MAP))
        while (yield from _map_segment(period_s, himm)):
            pass


def _map_segment(period_s: float, himm: HimmSetting) -> Generator[Step, Any, bool]:
    """Make maps along a segment until its last light; True where the next segment began before that."""
    while (yield from _taken(LIGHT_DETECTED)):  # a light of the segment before
        pass
    lights_left = int((yield from do("DServer", data.get(GOAL_DISTANCE, type=float))))
    local, origin, lights, heard_ns = HimmMap(himm), None, 0, -1
    while lights_left > 0:
        yield from sleep(period_s)
        if (yield from _taken(START_MAP)):
            return True
        scan, where = yield from _scan_and_position()
        if origin is not None and scan is not None and where is not None and scan.t_ns != heard_ns:
            heard_ns = scan.t_ns
            local.mark(local_pose(origin, _pose(where)), np.array(scan.ranges))
        if not (yield from _taken(LIGHT_DETECTED)):
            continue
        lights, lights_left = lights + 1, lights_left - 1
        if origin is not None and lights == LIGHTS_A_MAP:
            yield from _correct_heading(local, origin)
        if lights in (1, LIGHTS_A_MAP):
            where = yield from _asked("RServer", robot.position())
            origin, lights = None if where is None else _pose(where), 1
            local.clear()
    return False


def _correct_heading(local: HimmMap, origin: Pose) -> Generator[Step, Any, None]:
    """Turn RServer's heading so that the hallway in the map leads where the goal is."""
    lines = lines_in(local.cells())
    if not lines:
        return
    goal = yield from do("DServer", data.get(GOAL_DIRECTION, type=float))
    seen = directed(origin.heading_deg + lines[0].angle_deg, goal)
    yield from _adjusted(Correction(x_mm=0.0, y_mm=0.0, heading_deg=wrapped(goal - seen)))


def _pose(where: Position) -> Pose:
    return Pose(where.x, where.y, where.heading)


def _scan_and_position() -> Generator[Step, Any, tuple[SonarReading | None, Position | None]]:
    """The newest scan, and the position right after it; None for what is not known now."""
    scan = yield from _asked("PServer", proximity.sonar())
    where = yield from _asked("RServer", robot.position())
    return scan, where


def _adjusted(by: Correction) -> Generator[Step, Any, bool]:
    """Correct RServer's position; False where RServer is away."""
    try:
        yield from do("RServer", robot.adjust_position(by.x_mm, by.y_mm, by.heading_deg))
    except ConnectionProblem as problem:
        _pass_over(problem)
        return False
    return True


def _asked(server: str, ask: Ask[T]) -> Generator[Step, Any, T | None]:
    """What a server answers; None while it is away, or has no value yet."""
    try:
        return (yield from do(server, ask))
    except ConnectionProblem as problem:
        _pass_over(problem)
        return None


def _pass_over(problem: ConnectionProblem) -> None:
    """A server that dies is started again; but what it refuses now it will always refuse."""
    if isinstance(problem, CallRefused) and problem.code != "no value":
        raise problem


def _taken(semaphore: str) -> Generator[Step, Any, bool]:
    """Take one from a semaphore; False where there is none to take."""
    try:
        yield from do("DServer", data.wait(semaphore, 0.0))
    except CallRefused as refused:
        if refused.code != "timeout":
            raise
        return False
    return True
