"""A mission: its route, the scripts around the Navigator that lead the robot along it, and its result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from colony.body.model import Body
from colony.body.shipped import ROME, shipped_body
from colony.nav.maps.building import Building, load_building
from colony.nav.maps.signs import markers_of, plates_of
from colony.nav.maps.walls import walls_of
from colony.nav.missions.clerk import clerk
from colony.nav.missions.goal_verification import GoalVerdict, plate_at
from colony.nav.plan.plan import Plan
from colony.nav.plan.planner import OnSegment, OnVerdict, planner
from colony.nav.plan.route import NoPlanError, plan
from colony.nav.pose.estimate import pose_estimator
from colony.nav.pose.tracker import EVERY_SOURCE, PoseSource
from colony.runs.spec import MissionResult, MisuseError, RunSpec
from colony.runtime.kit.script import Script
from colony.vision.lights.tracker import light_tracker


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """A building, and a plan that leads through it."""

    building: Building
    plan: Plan

    @property
    def name(self) -> str:
        """The name for people: "from 350R to 250R of msu_engineering_2 (ldvld)"."""
        ends = [self.plan.segments[0].start.floor, self.plan.segments[-1].end.floor]
        floor = f" of {ends[1]}" if ends[0] != ends[1] else ""
        return f"from {self.plan.origin} to {self.plan.goal}{floor} ({self.plan.modes})"


def planned_route(spec: RunSpec) -> Route:
    """Return the requested route.

    Raises:
        MisuseError: the route does not exist.
        DiagnosticError: the map, or one that its elevators lead to, is invalid.
    """
    assert spec.world.map_path is not None
    assert spec.origin is not None
    assert spec.goal is not None
    building = load_building(spec.world.map_path)
    try:
        return Route(building=building, plan=plan(building, spec.origin, spec.goal))
    except NoPlanError as problem:
        raise MisuseError(f"{spec.world.map_path}: error: {problem}") from None


def expect_rome(body: Body) -> None:
    """Raise MisuseError unless a simulated robot has the body of RoME, which missions are made for."""
    rome = shipped_body(ROME)
    if (body.chassis, body.servers) != (rome.chassis, rome.servers):
        problem = f"`{body.robot.name}` has another body: missions are for the sensors and cameras of RoME"
        raise MisuseError(f"--from and --to: error: {problem}")


# --- the expected time -------------------------------------------------------------------------------


CORNER_S = 10.0
"""Additional seconds for a corner, and for the beginning and the end of a plan together."""

RIDE_S = 60.0
"""Seconds for an elevator ride, including the wait, the doors, and driving in and out."""

TIME_LIMIT_FACTOR = 3.0
"""Time limit of a run, in multiples of its expected time."""

GOAL_RADIUS_MM = 1000.0
"""Maximum true distance in mm at which the goal counts as reached."""


def expected_s(plan: Plan, mean_mm_s: float) -> float:
    """Return the time in seconds of a plan without incidents, at a mean speed of `mean_mm_s`."""
    turns_s = CORNER_S * (plan.modes.count("c") + 1)
    return plan.travel_mm / mean_mm_s + turns_s + RIDE_S * plan.modes.count("v")


def time_limit_ns(plan: Plan, mean_mm_s: float) -> int:
    """Return the time limit of a simulated run, in nanoseconds."""
    return round(TIME_LIMIT_FACTOR * expected_s(plan, mean_mm_s) * 1e9)


# --- the scripts -------------------------------------------------------------------------------------


CEILING_CAMERA, SIDE_CAMERA, FRONT_CAMERA = "CServerUp", "CServerSide", "CServerFront"
PLANNER = "planner"

EXPECTED_MM_S = 250.0
"""The robot's expected mean speed in mm/s, without incidents."""


def navigation_scripts(
    plan: Plan,
    building: Building,
    on_segment: OnSegment | None = None,
    *,
    sources: frozenset[PoseSource] = EVERY_SOURCE,
    cameras: frozenset[str] = frozenset({CEILING_CAMERA}),
    on_verdict: OnVerdict | None = None,
) -> Mapping[str, Script]:
    """Return the scripts around the Navigator, in their order of execution.

    Args:
        plan: the plan to drive.
        building: all floors of the plan, the first one first.
        on_segment: callback at the beginning of each segment, with its number, from 0, and the segment.
        sources: the sources of the pose estimate. Without `LIGHTS` the tracker counts lights by the pose
            alone.
        cameras: the cameras of the robot.
        on_verdict: callback for the verdict on the goal's plate, if the robot has a camera for plates.
    """
    has_lights = CEILING_CAMERA in cameras and PoseSource.LIGHTS in sources
    goal = building.map_named(plan.segments[-1].end.floor)
    return {
        "clerk": clerk(),
        "tracker": light_tracker(cameras=(CEILING_CAMERA,) if has_lights else ()),
        **_finders(building, cameras),
        "mapper": pose_estimator({floor.name: walls_of(floor) for floor in building.maps}, sources=sources),
        PLANNER: planner(
            plan,
            on_segment=on_segment,
            goal_plate=plate_at(goal, plan.goal) if SIDE_CAMERA in cameras else None,
            on_verdict=on_verdict,
        ),
    }


def _finders(building: Building, cameras: frozenset[str]) -> Mapping[str, Script]:
    """Return the finders of door plates and elevator markers for which there is a camera."""
    finders: dict[str, Script] = {}
    if SIDE_CAMERA in cameras:
        from colony.vision.plates.finder import plate_finder

        plates = {floor.name: plates_of(floor) for floor in building.maps}
        finders["plates"] = plate_finder(plates, camera=SIDE_CAMERA)
    if FRONT_CAMERA in cameras:
        from colony.vision.markers.finder import marker_finder

        markers = {floor.name: markers_of(floor) for floor in building.maps}
        finders["markers"] = marker_finder(markers, camera=FRONT_CAMERA)
    return finders


# --- the result --------------------------------------------------------------------------------------


_PLATE_TEXTS = {
    GoalVerdict.UNSEEN: "",
    GoalVerdict.RIGHT: "; the goal's plate was read",
    GoalVerdict.WRONG: "; another plate was read at the goal",
}
"""Texts about the door plate at the goal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ending:
    """The end of a mission.

    Attributes:
        is_done: True if the planner was done.
        problem: the error that a script raised; "" for none.
        duration_s: the duration in seconds.
        floor: the name of the map of the robot's floor.
        goal_error_mm: the robot's distance from the goal, in mm, if it is on the same floor.
        source: the source of floor and distance; "" if they are true.
        verdict: the verdict of the plates on the goal.
    """

    is_done: bool
    problem: str
    duration_s: float
    floor: str
    goal_error_mm: float
    source: str = ""
    verdict: GoalVerdict = GoalVerdict.UNSEEN


def mission_result(route: Route, ending: Ending) -> MissionResult:
    """Return the result of a mission: the robot arrived if the planner was done and it is at the goal."""
    goal_floor = route.plan.segments[-1].end.floor
    is_near = ending.floor == goal_floor and ending.goal_error_mm <= GOAL_RADIUS_MM
    arrived = ending.is_done and is_near and not ending.problem
    where = f"{ending.goal_error_mm / 1000:.2f} m from the goal"
    if ending.floor != goal_floor:
        where = f"on {ending.floor}, not on {goal_floor}"
    if ending.source:
        where += f" by {ending.source}"
    event = "the planner was done" if ending.is_done else "not done"
    if ending.problem:
        event = "broke off"
    elif arrived:
        event = "arrived"
    text = f"{route.name}: {event} after {ending.duration_s:.1f} s, {where}"
    if ending.problem:
        text += f": {ending.problem}"
    if arrived:
        speed = route.plan.distance_mm / ending.duration_s * 0.06
        text += f"; {route.plan.distance_mm / 1000:.1f} m, {speed:.1f} m/min{_PLATE_TEXTS[ending.verdict]}"
    return MissionResult(arrived=arrived, text=text)
