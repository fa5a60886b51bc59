"""The Path Planner's local part: a client that passes a plan's segments to the Navigator (sections 5.3, 5.8).

For each segment it sets GoalType, GoalDirection and GoalDistance, ups $GoalData, and waits for $RobotStatus.
A segment of lights also goes to CTracker, by LightOffset and $TrackData, and to the Local Mapper, by
$StartMap; the Planner then also waits for $EndLMode, and reads Overshoot.

The distance of a goal is the remaining length of its segment from the robot's estimated position, which other
clients keep correcting; or whatever remains by another function of the robot's progress.

Before an elevator segment, the Planner sets ElevatorCall for the operator of the buttons. Afterwards it
converts the position to the new floor's map, and then sets Floor for the clients that need the walls around
the robot.

If a Planner dies, the robot continues to the current goal and stops there. The next Planner starts with a
plan from the robot's position: its first goal replaces the pursued one, and pending answers are discarded. If
another client sets GoalType to NONE, the robot halts while the Planner keeps waiting. This does not pause the
goal: the Navigator would measure its whole distance again. To stop for good, end the Planner, then set
GoalType to NONE; to continue, start another Planner.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from itertools import pairwise
from typing import Any, NamedTuple, assert_never

from colony.nav.maps.signs import Plate
from colony.nav.maps.stickrep.geometry import Point, direction
from colony.nav.missions.elevator_calls import ElevatorCall
from colony.nav.missions.goal_verification import GoalVerdict, goal_verdict, remember_plates
from colony.nav.plan.plan import Plan, Segment
from colony.nav.shared import (
    ELEVATOR_CALL,
    END_L_MODE,
    FLOOR,
    GOAL_DATA,
    GOAL_DIRECTION,
    GOAL_DISTANCE,
    GOAL_TYPE,
    GOAL_VERIFIED,
    LIGHT_OFFSET,
    OVERSHOOT,
    ROBOT_STATUS,
    SEMAPHORES,
    START_MAP,
    TRACK_DATA,
    GoalKind,
    try_wait,
)
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data, robot

INTO_ELEVATOR_MM = 900.0
"""Distance behind the doors at which a robot stands in an elevator: the center of a cabin 1.8 m deep."""

MIN_SHORTFALL_MM, MAX_SHORTFALL_MM = 50.0, 1_500.0
"""Limits of a robot's distance before its goal, as measured by the plate there.

A robot farther from its goal than the minimum drives on; one farther than the maximum is lost, and stays
where it is.
"""

Progress = Callable[[Segment, float], Generator[Step, Any, float]]
"""Step of a script that returns the robot's distance from a segment's start, in mm, along its heading.

It is given the robot's distance beyond the last light of the segment before, 0 if unknown.
"""

OnSegment = Callable[[int, Segment], None]
"""Callback with the number, from 0, of each segment that begins."""

OnVerdict = Callable[[GoalVerdict], None]
"""Callback with the final verdict of the plates on the goal."""


class Goal(NamedTuple):
    """A goal for the Navigator; `offsets_mm` is for CTracker."""

    kind: GoalKind
    direction_deg: float
    distance: float
    offsets_mm: tuple[float, ...] = ()


def goal_of(segment: Segment, progress_mm: float) -> Goal:
    """Return the goal of a segment for a robot at this distance from its start.

    Lights behind the robot are left out. If nothing is left of a segment, its goal is 0 mm away, and the
    Navigator reaches it at once; so each segment has exactly one goal.

    Raises:
        ValueError: the segment has the kind NONE.
    """
    match segment.kind:
        case GoalKind.LIGHTS:
            ahead = [light - progress_mm for light in segment.lights_mm if light > progress_mm]
            if not ahead:
                return Goal(GoalKind.DEAD_RECKONING, segment.heading_deg, 0.0)
            offsets = (ahead[0], *(after - before for before, after in pairwise(ahead)))
            return Goal(segment.kind, segment.heading_deg, len(ahead), offsets)
        case GoalKind.CORNER | GoalKind.DEAD_RECKONING | GoalKind.ENTER_CORNER:
            return Goal(segment.kind, segment.heading_deg, max(segment.length_mm - progress_mm, 0.0))
        case GoalKind.ELEVATOR:
            to_doors_mm = max(segment.doors_mm[0] - progress_mm, 0.0)
            return Goal(segment.kind, segment.heading_deg, to_doors_mm + INTO_ELEVATOR_MM)
        case GoalKind.NONE:
            raise ValueError("expected a segment that leads somewhere; found one of the kind NONE")
        case _:
            assert_never(segment.kind)


def progress_along(segment: Segment, x_mm: float, y_mm: float) -> float:
    """Return the distance of a point from a segment's start, along its heading, in mm."""
    unit = direction(segment.heading_deg)
    return (x_mm - segment.start.x_mm) * unit.x + (y_mm - segment.start.y_mm) * unit.y


def position_after_ride(ride: Segment, x_mm: float, y_mm: float) -> Point:
    """Return the position of a robot after an elevator ride, in mm on the new floor's map.

    Its distance from the doors is that on the old floor, even if the corridor has another width.

    Args:
        ride: the elevator's segment.
        x_mm: x of the robot's odometry, as if it had left the elevator on the old floor.
        y_mm: y of the robot's odometry.
    """
    unit, ahead = direction(ride.turn_deg), direction(ride.heading_deg + ride.turn_deg)
    x, y = x_mm - ride.start.x_mm, y_mm - ride.start.y_mm
    shift = ride.doors_mm[1] - ride.doors_mm[0]
    return Point(
        ride.end.x_mm + unit.y * x + unit.x * y + shift * ahead.x,
        ride.end.y_mm - unit.x * x + unit.y * y + shift * ahead.y,
    )


def planner(
    plan: Plan,
    *,
    progress: Progress | None = None,
    on_segment: OnSegment | None = None,
    goal_plate: Plate | None = None,
    on_verdict: OnVerdict | None = None,
) -> Script:
    """Lead the robot along a plan; end when it has stopped at the goal.

    Args:
        plan: the plan.
        progress: the source of the robot's progress; by default its estimated position.
        on_segment: callback at the start of each segment.
        goal_plate: the plate at the goal; None to verify nothing. GoalVerified is set to the verdict; a robot
            that is short of the goal according to the plate drives the rest.
        on_verdict: callback with the final verdict.
    """
    yield from _begin(plan.segments[0].start.floor)
    if goal_plate is not None:
        yield from remember_plates()
    find_progress = _progress_by_position if progress is None else progress
    overshoot_mm, segment_start_ns = 0.0, 0
    for number, segment in enumerate(plan.segments):
        if on_segment is not None:
            on_segment(number, segment)
        if goal_plate is not None:
            segment_start_ns = yield from sleep(0.0)
        if segment.kind is GoalKind.ELEVATOR:
            call = ElevatorCall(segment.doors[0], segment.start.floor, segment.end.floor)
            yield from do("DServer", data.set(ELEVATOR_CALL, list(call)))
        goal = goal_of(segment, (yield from find_progress(segment, overshoot_mm)))
        overshoot_mm = yield from _pursue(goal)
        if segment.kind is GoalKind.ELEVATOR:
            yield from _change_floor(segment)
    yield from do("DServer", data.set(GOAL_TYPE, int(GoalKind.NONE)))
    if goal_plate is not None:
        verdict = yield from _verify(goal_plate, plan.segments[-1], segment_start_ns)
        if on_verdict is not None:
            on_verdict(verdict)


def _progress_by_position(segment: Segment, overshoot_mm: float) -> Generator[Step, Any, float]:
    here = yield from do("RServer", robot.position())
    return progress_along(segment, here.x, here.y)


def _begin(floor: str) -> Generator[Step, Any, None]:
    """Create missing semaphores, and drain those that an interrupted Planner has upped."""
    for name in SEMAPHORES:
        yield from do("DServer", data.create_semaphore(name, 0))
    for name in (START_MAP, TRACK_DATA, GOAL_DATA):
        yield from _drain(name)
    yield from do("DServer", data.set_many({FLOOR: floor, ELEVATOR_CALL: []}))


def _verify(plate: Plate, last: Segment, segment_start_ns: int) -> Generator[Step, Any, GoalVerdict]:
    """Wait for the verdict on the goal; drive the rest of the path by the corrected position."""
    verdict = yield from goal_verdict(plate, segment_start_ns=segment_start_ns)
    here = yield from do("RServer", robot.position())
    remaining_mm = last.length_mm - progress_along(last, here.x, here.y)
    if MIN_SHORTFALL_MM < remaining_mm < MAX_SHORTFALL_MM:
        yield from _pursue(Goal(GoalKind.DEAD_RECKONING, last.heading_deg, remaining_mm))
        yield from do("DServer", data.set(GOAL_TYPE, int(GoalKind.NONE)))
    yield from do("DServer", data.set(GOAL_VERIFIED, int(verdict)))
    return verdict


def _drain(semaphore: str) -> Generator[Step, Any, None]:
    while (yield from try_wait(semaphore, 0.0)):
        pass


def _pursue(goal: Goal) -> Generator[Step, Any, float]:
    """Set a goal, and wait until it is reached; return the overshoot, 0 if unknown."""
    values: dict[str, object] = {
        GOAL_TYPE: int(goal.kind),
        GOAL_DIRECTION: goal.direction_deg,
        GOAL_DISTANCE: goal.distance,
    }
    lights = goal.kind is GoalKind.LIGHTS
    if lights:
        values[LIGHT_OFFSET] = list(goal.offsets_mm)
    yield from do("DServer", data.set_many(values))
    # Answers that are already pending belong to goals of an interrupted Planner.
    yield from _drain(ROBOT_STATUS)
    yield from _drain(END_L_MODE)
    if lights:
        yield from do("DServer", data.signal(TRACK_DATA))
        yield from do("DServer", data.signal(START_MAP))
    yield from do("DServer", data.signal(GOAL_DATA))
    overshoot_mm = 0.0
    if lights:
        yield from do("DServer", data.wait(END_L_MODE))
        overshoot_mm = float((yield from do("DServer", data.get(OVERSHOOT))))
    yield from do("DServer", data.wait(ROBOT_STATUS))
    return overshoot_mm


def _change_floor(ride: Segment) -> Generator[Step, Any, None]:
    """Convert the base's position from the old floor's map to the new floor's."""
    here = yield from do("RServer", robot.position())
    after = position_after_ride(ride, here.x, here.y)
    yield from do("RServer", robot.adjust_position(after.x - here.x, after.y - here.y, ride.turn_deg))
    yield from do("DServer", data.set_many({FLOOR: ride.end.floor, ELEVATOR_CALL: []}))
