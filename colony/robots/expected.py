"""The time that a plan is expected to take, the longest that a run waits, and how near its goal it ends."""

from __future__ import annotations

from colony.nav.plan.plan import Plan

CORNER_S = 10.0
"""What a corner is expected to take besides the way; so are the beginning and the end together."""

RIDE_S = 60.0
"""What an elevator is expected to take: until it comes, its doors, the ride, the way in and out."""

PATIENCE = 3.0
"""How many times the expected time a run may take."""

AT_GOAL_MM = 1000.0
"""A robot that is farther from the goal has not reached it, whatever it believes."""


def expected_s(plan: Plan, mm_s: float) -> float:
    """The time where nothing goes wrong, for a robot that is so fast in the mean."""
    turns_s = CORNER_S * (plan.modes.count("c") + 1)
    return plan.way_mm / mm_s + turns_s + RIDE_S * plan.modes.count("v")


def longest_ns(plan: Plan, mm_s: float) -> int:
    """After which time a simulated run makes no sense any more."""
    return round(PATIENCE * expected_s(plan, mm_s) * 1e9)
