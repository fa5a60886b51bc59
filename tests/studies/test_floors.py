"""Runs from floor to floor."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.experiment.results import RunKey
from colony.runs.navigation import CEILING_CAMERA, FRONT_CAMERA
from colony.sim.hazards.hazards import Hazards
from studies.runs import Run, StudyRun
from tests.nav.floors import two_floors


def specified(folder: Path) -> StudyRun:
    two_floors(folder)
    return StudyRun(
        key=RunKey("floors", 1, 1, "ours"),
        map_path=folder / "ground.stickrep",
        origin="liftR",
        goal="upper:D",
        hazards=Hazards.none(),
        cameras=frozenset({CEILING_CAMERA, FRONT_CAMERA}),
    )


@pytest.mark.thorough
def test_a_run_to_another_floor_reaches_its_goal_there(tmp_path: Path) -> None:
    run = Run(specified(tmp_path))
    while run.step():
        pass
    run.close()
    found = run.result()
    assert (found.failure, found.remark, run.site.floor) == ("", "", "upper")
    assert (found.planned_modes, found.completed) == ("dvd", 3)
    assert found.goal_error_mm < 200.0
    assert found.contacts.fastest_mm_s == 0.0
    assert "slips" not in found.hazards


def test_who_is_at_the_goal_of_another_floor_is_astray(tmp_path: Path) -> None:
    """The place below the goal is not the goal."""
    run = Run(specified(tmp_path))
    run.loop.scripts.has_ended = lambda name: True  # type: ignore[method-assign]
    goal = run.plan.segments[-1].end
    run.world.place(0, (goal.x_mm, 1100.0, 90.0))
    assert run.goal_error_mm < 1000.0
    assert not run.step()
    run.close()
    assert (run.failure, run.remark) == ("astray", "on ground")
