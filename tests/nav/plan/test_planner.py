"""The Planner's script: its calls for the Navigator and CTracker, and their order."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from colony.nav.maps.signs import Plate
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.missions.goal_verification import GoalVerdict
from colony.nav.plan.plan import FloorPoint, Plan, Segment
from colony.nav.plan.planner import (
    INTO_ELEVATOR_MM,
    Goal,
    goal_of,
    planner,
    position_after_ride,
    progress_along,
)
from colony.nav.shared import (
    CEILING_LIGHT,
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
    PLATE_SEEN,
    ROBOT_STATUS,
    SEMAPHORES,
    START_MAP,
    TRACK_DATA,
    GoalKind,
)
from colony.runtime.kit.script import Script, Sleep, do
from colony.runtime.library import data
from tests.kit.script_stage import RobotStage


def at(x: float, y: float, floor: str = "f") -> FloorPoint:
    return FloorPoint(x, y, floor)


def segment(kind: GoalKind, heading: float, start: FloorPoint, end: FloorPoint, *lights: float) -> Segment:
    return Segment(kind=kind, heading_deg=heading, start=start, end=end, width_mm=2500.0, lights_mm=lights)


LIGHTS = segment(GoalKind.LIGHTS, 0.0, at(0, 0), at(0, 8000), 2000.0, 5000.0, 8000.0)
ENTER = segment(GoalKind.ENTER_CORNER, 0.0, at(0, 8000), at(0, 12000))
LEAVE = segment(GoalKind.CORNER, 90.0, at(0, 12000), at(-2000, 12000))
LAST = segment(GoalKind.DEAD_RECKONING, 90.0, at(-2000, 12000), at(-6000, 12000))
PLAN = Plan(origin="a", goal="b", segments=(LIGHTS, ENTER, LEAVE, LAST), distance_mm=18000.0, modes="lcd")


Errors = Callable[[Goal], tuple[float, float]]
"""How far ahead of a goal, and to the left of it, the robot ends."""


def exactly(goal: Goal) -> tuple[float, float]:
    return 0.0, 0.0


def obedient(stage: list[RobotStage], error: Errors, after_s: float = 0.0) -> Script:
    """In place of Navigator and CTracker: at each goal the robot is `error` ahead and to the left of it."""
    yield Sleep(after_s)
    for name in SEMAPHORES:
        yield from do("DServer", data.create_semaphore(name, 0))
    while True:
        yield from do("DServer", data.wait(GOAL_DATA))
        values = yield from do("DServer", data.get_many((GOAL_TYPE, GOAL_DIRECTION, GOAL_DISTANCE)))
        kind, heading, distance = values[GOAL_TYPE], values[GOAL_DIRECTION], values[GOAL_DISTANCE]
        way = distance
        if kind == GoalKind.LIGHTS:
            yield from do("DServer", data.wait(TRACK_DATA))
            yield from do("DServer", data.wait(START_MAP))
            way = sum((yield from do("DServer", data.get(LIGHT_OFFSET))))
        if kind == GoalKind.ELEVATOR:
            way = 0.0  # in, and out again
        ahead, left = error(Goal(GoalKind(kind), heading, distance))
        angle = math.radians(heading)
        robot = stage[0]
        robot.x += -math.sin(angle) * (way + ahead) - math.cos(angle) * left
        robot.y += math.cos(angle) * (way + ahead) - math.sin(angle) * left
        if kind == GoalKind.LIGHTS:
            yield from do("DServer", data.set_many({OVERSHOOT: ahead, CEILING_LIGHT: distance}))
            yield from do("DServer", data.signal(END_L_MODE))
        yield from do("DServer", data.signal(ROBOT_STATUS))


def staged(
    plan: Plan,
    error: Errors = exactly,
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    obeys_after_s: float = 0.0,
    **options: Any,
) -> RobotStage:
    """The planner and a robot that obeys it after a while, which begins at x, y and a heading."""
    stage: list[RobotStage] = []
    made = RobotStage(robot=obedient(stage, error, obeys_after_s), planner=planner(plan, **options))
    stage.append(made)
    made.x, made.y, made.heading = at
    return made


def driven(plan: Plan, ahead: float = 0.0, left: float = 0.0, **options: Any) -> RobotStage:
    """A whole plan, with a robot that is always so far beyond its goals."""
    made = staged(plan, lambda goal: (ahead, left), **options)
    made.run(10.0)
    assert made.ended == {"planner"}
    return made


def goals(stage: RobotStage) -> list[tuple[str, float, float]]:
    """Mode, direction and distance of each goal that was set."""
    found = []
    for values in stage.said("planner", "set_many"):
        if GOAL_TYPE not in values:
            continue  # of floors and elevators
        found.append((chr(values[GOAL_TYPE]), values[GOAL_DIRECTION], values[GOAL_DISTANCE]))
    return found


def test_a_plan_is_told_segment_by_segment() -> None:
    seen: list[tuple[int, Segment]] = []
    stage = driven(PLAN, on_segment=lambda number, segment: seen.append((number, segment)))
    assert goals(stage) == [("L", 0.0, 3), ("E", 0.0, 4000.0), ("C", 90.0, 2000.0), ("D", 90.0, 4000.0)]
    assert seen == list(enumerate(PLAN.segments))
    assert (stage.x, stage.y) == pytest.approx((-6000.0, 12000.0))
    assert stage.variable(GOAL_TYPE) == GoalKind.NONE


def test_it_makes_the_semaphores_and_uses_none_but_those_of_the_table() -> None:
    stage = driven(PLAN)
    assert stage.said("planner", "create_semaphore") == [{name: 0} for name in SEMAPHORES]
    assert [name for values in stage.said("planner", "signal") for name in values] == [
        TRACK_DATA, START_MAP, GOAL_DATA, GOAL_DATA, GOAL_DATA, GOAL_DATA,
    ]  # fmt: skip
    written = {name for values in stage.said("planner", "set", "set_many") for name in values}
    assert written == {GOAL_TYPE, GOAL_DIRECTION, GOAL_DISTANCE, LIGHT_OFFSET, FLOOR, ELEVATOR_CALL}


def test_what_a_goal_is_stands_before_it_is_announced() -> None:
    """Who is woken by a semaphore reads at once."""
    stage = driven(PLAN)
    by_planner = [
        (how, tuple(values))
        for by, how, values in stage.calls
        if by == "planner" and how != "create_semaphore"
    ]
    assert by_planner[0][1] == (FLOOR, ELEVATOR_CALL)
    assert by_planner[1][0] == "set_many"
    assert by_planner[2:5] == [("signal", (name,)) for name in (TRACK_DATA, START_MAP, GOAL_DATA)]
    assert stage.variable(LIGHT_OFFSET) == [2000.0, 3000.0, 3000.0]


def by_overshoot(segment: Segment, overshoot_mm: float) -> Script:
    yield from ()
    return overshoot_mm


@pytest.mark.parametrize(
    ("options", "enter", "last"),
    [
        # Each overshoot is taken off the next goal of the same leg. Behind the corner it is one to the side.
        ({"ahead": 150.0}, 3850.0, 3850.0),
        # By a progress of its own that of lights is taken off, and the position changes nothing.
        ({"ahead": 150.0, "progress": by_overshoot}, 3850.0, 4000.0),
        ({"progress": by_overshoot, "at": (777.0, -999.0, 0.0)}, 4000.0, 4000.0),
    ],
    ids=["by the pose", "by the overshoot", "elsewhere"],
)
def test_each_goal_is_what_is_left(options: dict[str, Any], enter: float, last: float) -> None:
    made = driven(PLAN, **options)
    assert goals(made) == [("L", 0.0, 3), ("E", 0.0, enter), ("C", 90.0, 2000.0), ("D", 90.0, last)]


def test_a_corner_is_turned_where_nothing_is_left_to_drive() -> None:
    def drifting(goal: Goal) -> tuple[float, float]:
        return (0.0, 2500.0) if goal.kind is GoalKind.ENTER_CORNER else (0.0, 0.0)

    made = staged(replace(PLAN, segments=(ENTER, LEAVE, LAST)), drifting, (0.0, 8000.0, 0.0))
    made.run(10.0)
    assert goals(made) == [("E", 0.0, 4000.0), ("C", 90.0, 0.0), ("D", 90.0, 3500.0)]


def test_a_goal_that_is_behind_is_reached_at_once() -> None:
    """Also lights: so goals are counted as segments are."""
    stage = driven(replace(PLAN, segments=(LIGHTS, ENTER, LIGHTS)), ahead=5000.0)
    assert goals(stage) == [("L", 0.0, 3), ("E", 0.0, 0.0), ("D", 0.0, 0.0)]
    assert len(stage.said("planner", "signal")) == 2 + 3
    assert stage.variable(GOAL_TYPE) == GoalKind.NONE


def test_a_segment_leads_somewhere() -> None:
    with pytest.raises(ValueError, match="found one of the kind NONE"):
        goal_of(replace(LAST, kind=GoalKind.NONE), 0.0)


@pytest.mark.parametrize(
    ("progress", "expected"),
    [
        (0.0, (3, (2000.0, 3000.0, 3000.0))),
        (-400.0, (3, (2400.0, 3000.0, 3000.0))),
        (2500.0, (2, (2500.0, 3000.0))),
        (7999.0, (1, (1.0,))),
        (8000.0, (0.0, ())),
    ],
)
def test_lights_that_are_behind_are_not_tracked(
    progress: float, expected: tuple[float, tuple[float, ...]]
) -> None:
    goal = goal_of(LIGHTS, progress)
    assert (goal.distance, goal.offsets_mm) == expected


def test_progress_is_along_the_segment() -> None:
    assert progress_along(LEAVE, -500.0, 12345.0) == pytest.approx(500.0)
    assert progress_along(LAST, 0.0, 12000.0) == pytest.approx(-2000.0)


def test_a_planner_takes_no_answer_that_was_meant_for_another() -> None:
    made = staged(replace(PLAN, segments=(LAST,)), at=(-2000.0, 12000.0, 0.0), obeys_after_s=0.2)
    left_over = (ROBOT_STATUS, END_L_MODE, START_MAP, TRACK_DATA, GOAL_DATA)
    for name in SEMAPHORES:
        made.ask(data.create_semaphore(name, 2 if name in left_over else 0))
    made.run(0.1)
    assert [made.semaphore(name) for name in left_over] == [0, 0, 0, 0, 1]
    made.run(10.0)
    assert made.x == pytest.approx(-6000.0)
    assert made.ended == {"planner"}


def test_an_answer_that_comes_late_is_none_to_the_next_goal() -> None:
    """The clerk may just have been about to answer the goal of the Planner before."""
    stage = RobotStage(planner=planner(PLAN, on_segment=lambda number, _: stage.signal(ROBOT_STATUS)))
    for name in SEMAPHORES:
        stage.ask(data.create_semaphore(name, 0))
    stage.run(1.0)
    stage.tell(OVERSHOOT, 0.0)
    stage.signal(END_L_MODE)
    stage.run(1.0)
    assert [values[0] for values in goals(stage)] == ["L"]
    stage.signal(ROBOT_STATUS)
    stage.run(1.0)
    assert [values[0] for values in goals(stage)] == ["L", "E"]


RIDE = Segment(
    kind=GoalKind.ELEVATOR,
    heading_deg=270.0,
    start=at(1000, 2000, "one"),
    end=at(5000, 5000, "two"),
    width_mm=1000.0,
    turn_deg=90.0,
    doors_mm=(1200.0, 1500.0),
    doors=("lift.one", "lift.two"),
)


def test_after_a_ride_the_robot_is_on_the_other_floor() -> None:
    # It came out 100 mm west of where it went in, looking west; there west is where here south is.
    made = driven(replace(PLAN, segments=(RIDE,)), at=(900.0, 2000.0, 90.0))
    # 100 mm more to the doors, and into the cabin.
    assert goals(made) == [("V", 270.0, 1200.0 + 100.0 + INTO_ELEVATOR_MM)]
    # The doors there are north of it, and the corridor is 300 mm wider on this side of them.
    assert (made.x, made.y, made.heading) == pytest.approx((5000.0, 5200.0, 180.0))
    assert position_after_ride(RIDE, 1000.0, 2000.0) == pytest.approx((5000.0, 5300.0))
    assert RIDE.length_mm == 0.0


def test_a_ride_is_called_for_and_when_it_is_over_the_floor_is_another() -> None:
    made = driven(replace(PLAN, segments=(RIDE,)))
    calls = [values for values in made.said("planner", "set") if ELEVATOR_CALL in values]
    floors = [values for values in made.said("planner", "set_many") if FLOOR in values]
    assert calls == [{ELEVATOR_CALL: ["lift.one", "one", "two"]}]
    assert floors == [{FLOOR: floor, ELEVATOR_CALL: []} for floor in ("one", "two")]
    # The position is that of the new floor's map before Floor is set.
    order = [
        how for _, how, values in made.calls if how == "adjust" or (how == "set_many" and FLOOR in values)
    ]
    assert order == ["set_many", "adjust", "set_many"]


def test_an_elevator_is_entered_however_near_its_doors_are() -> None:
    """A goal of 0 mm would make the Navigator turn around before them."""
    assert goal_of(RIDE, 5000.0).distance == INTO_ELEVATOR_MM
    assert goal_of(replace(RIDE, doors_mm=(0.0, 0.0)), 0.0).distance == INTO_ELEVATOR_MM


# --- what hangs at the goal -----------------------------------------------------------------------------

PLATE = Plate(
    edge=0, start_mm=0.0, end_mm=356.0, center=Point(-6000.0, 10800.0), heading_deg=180.0, door="b", text="12"
)


def arrived(seen: list[tuple[str, float]], ahead: float = 0.0, before_s: float = 0.0) -> RobotStage:
    """A whole plan, by a robot that is so far beyond its last goal when it arrives, and tells of plates then
    that it saw so long before."""
    stage: list[RobotStage] = []

    def finder() -> Script:
        yield from do("DServer", data.wait("$Arrived"))
        for number, (text, x) in enumerate(seen, 1):
            values = [stage[0].now_ns - round(before_s * 1e9), number, text, x, 10800.0]
            yield from do("DServer", data.set(PLATE_SEEN, values))

    def robot() -> Script:
        goals = 0
        yield from do("DServer", data.create_semaphore("$Arrived", 0))

        def error(goal: Goal) -> tuple[float, float]:
            nonlocal goals
            goals += 1
            if goals == len(PLAN.segments):
                stage[0].signal("$Arrived")
            return (ahead if goals == len(PLAN.segments) else 0.0), 0.0

        yield from obedient(stage, error)

    made = RobotStage(robot=robot(), finder=finder(), planner=planner(PLAN, goal_plate=PLATE))
    stage.append(made)
    made.run(30.0)
    assert "planner" in made.ended
    return made


@pytest.mark.parametrize(
    ("seen", "verdict"),
    [
        ([("12", -6100.0)], GoalVerdict.RIGHT),
        ([("14", -6100.0)], GoalVerdict.WRONG),
        ([("14", -6100.0), ("12", -5900.0), ("16", -3000.0)], GoalVerdict.RIGHT),
        ([("16", -3000.0)], GoalVerdict.UNSEEN),
        ([], GoalVerdict.UNSEEN),
    ],
)
def test_the_plate_at_the_goal_is_looked_for(seen: list[tuple[str, float]], verdict: GoalVerdict) -> None:
    stage = arrived(seen)
    assert stage.variable(GOAL_VERIFIED) == verdict
    assert stage.variable(GOAL_TYPE) == GoalKind.NONE


@pytest.mark.parametrize(("before_s", "verdict"), [(2.0, GoalVerdict.RIGHT), (60.0, GoalVerdict.UNSEEN)])
def test_a_plate_may_be_read_before_the_last_segment_but_not_long_before(
    before_s: float, verdict: GoalVerdict
) -> None:
    """The last segment may be 20 mm long, and the plate was in view all the time before."""
    assert arrived([("12", -6100.0)], before_s=before_s).variable(GOAL_VERIFIED) == verdict


@pytest.mark.parametrize(("ahead", "rest"), [(-200.0, 200.0), (-40.0, None), (300.0, None), (-1600.0, None)])
def test_what_is_left_of_the_way_by_then_is_driven(ahead: float, rest: float | None) -> None:
    stage = arrived([("12", -6000.0)], ahead)
    more = goals(stage)[len(PLAN.segments) :]
    assert [(mode, direction) for mode, direction, _ in more] == ([] if rest is None else [("D", 90.0)])
    assert [distance for *_, distance in more] == pytest.approx([] if rest is None else [rest])
    assert stage.variable(GOAL_TYPE) == GoalKind.NONE


def test_without_a_plate_to_verify_nothing_is_said_of_the_goal() -> None:
    assert driven(PLAN).told(GOAL_VERIFIED) is None
