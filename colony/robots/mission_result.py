"""The result of a mission, for people and for the exit code, in virtual time and over live connections."""

from __future__ import annotations

from dataclasses import dataclass

from colony.nav.missions.goal_verification import GoalVerdict
from colony.robots.expected import GOAL_RADIUS_MM
from colony.robots.request import MissionResult
from colony.robots.route import Route

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
