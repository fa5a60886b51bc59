"""The result of one run, as data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from colony.experiment.rows import Places

Mode = Literal["L", "C", "D"]
"""Ceiling lights, corner, dead reckoning: the modes as the thesis counts them, a corner as one."""

MODES: tuple[Mode, ...] = ("L", "C", "D")

FailureReason = Literal["", "stuck", "too long", "astray", "script"]
"""Reason why a run failed; "" if it did not.

stuck: for a minute the robot neither came out of a circle nor got a new goal. too long: it took three times
as long as expected. astray: the planner says that it is done, but the robot is not at the goal. script: a
client raised an exception.
"""


class RunKey(NamedTuple):
    """The key of a run: its list, its number there, the seed of all chance in it, and its variant."""

    runs: str
    number: int
    seed: int
    variant: str


class ModeCount(NamedTuple):
    """Counts of a mode: how often it was entered, completed, and needed by the plan."""

    entered: int
    completed: int
    needed: int


class LightCount(NamedTuple):
    """Ceiling lights of the legs that were driven.

    Lights counted where they hang, passed without being counted, and counted where none hangs.
    """

    seen: int
    missed: int
    false: int


class Contacts(NamedTuple):
    """The number of new contacts of the robot, and its largest speed in one of them."""

    number: int
    fastest_mm_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """One run.

    Attributes:
        key: key of the run.
        origin, goal: nodes of the map.
        failure, failed_mode: why it failed, and in which mode; "" if it reached the goal.
        remark: text for people: what a script raised, say.
        along_mm: final distance of the robot beyond the goal, along the last leg; negative: short of it.
        off_mm: straight-line distance from the goal.
        distance_mm: length of the path along the rings, which is what the published tables give.
        travelled_mm: distance that the robot really drove.
        time_s: from the start to the end of the planner.
        top_mm_s: its highest speed.
        modes: by mode, L, C, D.
        letters, completed: a letter a mode of the plan, and how many of them were completed.
        first_light: whether, on the leg of lights that it failed on, it had found the first one.
        lights, contacts: see there.
        hazards: what the scenery had on the robot's way, for people: "2 slips, 1 glass door".
        path: the true way, x and y in mm, a place a second.
    """

    key: RunKey
    origin: str
    goal: str
    failure: FailureReason
    failed_mode: Mode | Literal[""]
    remark: str
    along_mm: float
    off_mm: float
    distance_mm: float
    travelled_mm: float
    time_s: float
    top_mm_s: float
    modes: tuple[ModeCount, ModeCount, ModeCount]
    letters: str
    completed: int
    first_light: bool
    lights: LightCount
    contacts: Contacts
    hazards: str
    path: Places

    @property
    def reached(self) -> bool:
        """True if it reached the goal: the planner is done, and the robot within 1 m of it."""
        return not self.failure

    @property
    def mean_mm_s(self) -> float:
        """Mean speed as published: the distance along the rings by the run time."""
        return self.distance_mm / self.time_s if self.time_s > 0.0 else 0.0
