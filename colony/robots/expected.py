"""The expected time of a plan, the longest time of a run, and the radius of its goal."""

from __future__ import annotations

from colony.nav.plan.plan import Plan

CORNER_S = 10.0
"""Seconds for a corner besides the way, and for the beginning and the end of a plan together."""

RIDE_S = 60.0
"""Seconds for an elevator: the wait, its doors, the ride, the way in and out."""

PATIENCE = 3.0
"""Largest multiple of the expected time that a run may take."""

AT_GOAL_MM = 1000.0
"""Distance from the goal in mm beyond which a robot has not reached it, whatever it believes."""


def expected_s(plan: Plan, mm_s: float) -> float:
    """Return the time in seconds of a plan without incidents, at a mean speed of `mm_s`."""
    turns_s = CORNER_S * (plan.modes.count("c") + 1)
    return plan.way_mm / mm_s + turns_s + RIDE_S * plan.modes.count("v")


def longest_ns(plan: Plan, mm_s: float) -> int:
    """Return the time limit of a simulated run, in nanoseconds."""
    return round(PATIENCE * expected_s(plan, mm_s) * 1e9)
