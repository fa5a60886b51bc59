"""Results made by hand, for tests of what is done with results."""

from __future__ import annotations

from dataclasses import replace

from colony.experiment.results import RunKey
from studies.record import Contacts, LightCount, ModeCount, RunResult

REACHED = RunResult(
    key=RunKey("thesis", 1, 1, "ours"),
    origin="350R",
    goal="376L",
    failure="",
    failed_mode="",
    remark="",
    overshoot_mm=-20.25,
    goal_error_mm=25.25,
    distance_mm=78181.0,
    travelled_mm=78208.5,
    time_s=160.0,
    top_mm_s=500.0,
    mode_counts=(ModeCount(1, 1, 1), ModeCount(0, 0, 0), ModeCount(1, 1, 1)),
    planned_modes="ld",
    completed=2,
    first_light=True,
    lights=LightCount(14, 0, 0),
    contacts=Contacts(0, 0.0),
    hazards="doors open: 2",
    path=((100, -200), (300, 400)),
)

STUCK = replace(
    REACHED,
    failure="stuck",
    failed_mode="L",
    overshoot_mm=-40_000.0,
    goal_error_mm=40_000.0,
    mode_counts=(ModeCount(1, 0, 1), ModeCount(0, 0, 0), ModeCount(0, 0, 1)),
    completed=0,
    first_light=True,
    contacts=Contacts(3, 220.0),
)


def result(number: int, seed: int, like: RunResult = REACHED) -> RunResult:
    """The same of another run."""
    return replace(like, key=like.key._replace(number=number, seed=seed))
