"""The result of a run, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from colony.experiment.results import KEY_COLUMNS, Points, ResultTable, RunKey

Mode = Literal["L", "C", "D"]
"""The modes as the thesis counts them: ceiling lights, corner (entering and leaving), dead reckoning."""

MODES: tuple[Mode, ...] = ("L", "C", "D")

FailureReason = Literal["", "stuck", "too long", "astray", "script"]
"""Reason why a run failed; "" if it did not.

stuck: for a minute the robot neither moved nor got a new goal. too long: the run took three times the
expected time. astray: the planner is done, but the robot is not at the goal. script: a script raised an
exception.
"""


class ModeCount(NamedTuple):
    """The number of times that a mode was entered, completed, and required by the plan."""

    entered: int
    completed: int
    needed: int


class LightCount(NamedTuple):
    """Counts of the ceiling lights of the driven legs.

    Attributes:
        seen: number of lights counted by the robot at their positions.
        missed: number of lights passed without being counted.
        false: number of counts without a light.
    """

    seen: int
    missed: int
    false: int


class Contacts(NamedTuple):
    """The number of the robot's contacts, and its highest speed in one of them."""

    number: int
    fastest_mm_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """The result of a run.

    Attributes:
        key: key of the run.
        origin, goal: nodes of the map.
        failure, failed_mode: the reason and the mode of a failure; "" if the run reached the goal.
        remark: a text for people, such as the error that a script raised.
        overshoot_mm: final distance of the robot beyond the goal, along the last leg; negative if it stopped
            short.
        goal_error_mm: final straight-line distance from the goal.
        distance_mm: length of the path along the rings, as in the published tables.
        travelled_mm: distance that the robot actually drove.
        time_s: time from the start to the end of the planner.
        top_mm_s: highest speed.
        mode_counts: the counts of the modes L, C and D.
        planned_modes, completed: the modes of the plan, one letter each, and the number of completed ones.
        first_light: True if the first light was found on the leg of lights on which the run failed.
        lights, contacts: the counts of lights and of contacts.
        hazards: description of the hazards on the route: "lights out: 1, slips: 2".
        path: the true path, x and y in mm, one point per second.
    """

    key: RunKey
    origin: str
    goal: str
    failure: FailureReason
    failed_mode: Mode | Literal[""]
    remark: str
    overshoot_mm: float
    goal_error_mm: float
    distance_mm: float
    travelled_mm: float
    time_s: float
    top_mm_s: float
    mode_counts: tuple[ModeCount, ModeCount, ModeCount]
    planned_modes: str
    completed: int
    first_light: bool
    lights: LightCount
    contacts: Contacts
    hazards: str
    path: Points

    @property
    def reached(self) -> bool:
        """True if the run reached the goal: the planner is done, and the robot is within 1 m of the goal."""
        return not self.failure

    @property
    def mean_mm_s(self) -> float:
        """The mean speed as published: the distance along the rings divided by the time."""
        return self.distance_mm / self.time_s if self.time_s > 0.0 else 0.0


RUN_TABLE = ResultTable(
    name="run",
    kind=RunResult,
    columns=(
        *KEY_COLUMNS,
        *("origin", "goal", "failure", "failed_mode", "remark"),
        *("along_mm", "off_mm", "distance_mm", "travelled_mm", "time_s", "top_mm_s"),
        *(f"{mode.lower()}_{count}" for mode in MODES for count in ModeCount._fields),
        *("letters", "completed", "first_light"),
        *(f"lights_{count}" for count in LightCount._fields),
        *("contacts", "contact_mm_s", "hazards", "path"),
    ),
)
"""The table of ordinary runs; studies/experiments.md describes its columns."""
