"""What people read of a mission that is over, and when it counts as arrived."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from colony.nav.missions.goal_verification import GoalVerdict
from colony.nav.plan.route import plan
from colony.runs.navigation import Ending, Route, mission_result
from tests.nav.floors import two_floors

THERE = Ending(is_done=True, problem="", duration_s=60.0, floor="upper", goal_error_mm=120.0)
LOST = "RServer does not answer"


@pytest.mark.parametrize(
    ("ending", "arrived", "text"),
    [
        (THERE, True, "arrived after 60.0 s, 0.12 m from the goal; 2.2 m, 2.2 m/min"),
        (
            replace(THERE, verdict=GoalVerdict.WRONG, source="its odometry"),
            True,
            "arrived after 60.0 s, 0.12 m from the goal by its odometry; 2.2 m, 2.2 m/min; "
            "another plate was read at the goal",
        ),
        (
            replace(THERE, floor="ground"),
            False,
            "the planner was done after 60.0 s, on ground, not on upper",
        ),
        (
            replace(THERE, goal_error_mm=1001.0),
            False,
            "the planner was done after 60.0 s, 1.00 m from the goal",
        ),
        (
            replace(THERE, is_done=False, floor="ground"),
            False,
            "not done after 60.0 s, on ground, not on upper",
        ),
        (
            replace(THERE, is_done=False, problem=LOST),
            False,
            f"broke off after 60.0 s, 0.12 m from the goal: {LOST}",
        ),
    ],
)
def test_a_mission_is_arrived_at_its_goal_alone(
    ending: Ending, arrived: bool, text: str, tmp_path: Path
) -> None:
    building = two_floors(tmp_path)
    route = Route(building=building, plan=plan(building, "liftR", "upper:liftR"))
    result = mission_result(route, ending)
    assert result == (arrived, f"from liftR to liftR of upper (dvd): {text}", ())
