"""The expected time of a plan, the time limit of a run, and the radius of its goal."""

from __future__ import annotations

from colony.nav.plan.plan import Plan

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
