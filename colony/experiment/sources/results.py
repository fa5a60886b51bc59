"""Runs whose pose was estimated from different sources: as data, how they are kept, and in tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from colony.experiment.figures import Target, percentile
from colony.experiment.lists import ListedRun
from colony.experiment.record import FailureReason, RunKey
from colony.experiment.results import KEY_COLUMNS, Table
from colony.experiment.tables import markdown, targets_markdown

ALL_SOURCES, ODOMETRY = "all", "odometry alone"

HONEST = (0.85, 0.999)
"""Range of the part of true poses in the ellipsoid that should hold 95 in 100.

Within these bounds the covariance is right within a factor of about two, in either direction.
"""


class PoseErrors(NamedTuple):
    """Errors of the estimate against the true pose, along a run.

    `looks` is the number of comparisons; `square_mm2` and `square_deg2` are the sums of the squared errors of
    the position and the heading, `worst_mm` the worst error of the position; `inside` is how often the true
    pose lay in the ellipsoid that should hold 95 in 100.
    """

    looks: int = 0
    square_mm2: float = 0.0
    square_deg2: float = 0.0
    worst_mm: float = 0.0
    inside: int = 0


class SourceOutcome(NamedTuple):
    """The outcome of a run with some of the sources.

    Why it failed, "" if it reached the goal; how far from the goal the robot stood at last; the speed of its
    worst contact; the errors of the estimate along the way.
    """

    failure: FailureReason
    off_mm: float
    contact_mm_s: float
    errors: PoseErrors


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceResult:
    """One run, driven once for each choice of sources.

    Attributes:
        key: key of the run.
        origin, goal: nodes of the map.
        outcomes: by what was left out, as "no lights"; `ALL_SOURCES` and `ODOMETRY` are among them.
    """

    key: RunKey
    origin: str
    goal: str
    outcomes: Mapping[str, SourceOutcome]

    @property
    def failure(self) -> FailureReason:
        """Reason why the run with all sources failed."""
        return self.outcomes[ALL_SOURCES].failure


def source_targets(results: Sequence[SourceResult]) -> tuple[Target, ...]:
    """Compare the estimate from all sources with what is expected of it."""
    if not results:
        return ()
    outcomes = [result.outcomes[ALL_SOURCES] for result in results]
    looks = sum(outcome.errors.looks for outcome in outcomes)
    part = sum(outcome.errors.inside for outcome in outcomes) / looks if looks else 0.0
    reached = sum(not outcome.failure for outcome in outcomes)
    return (
        Target(
            what="runs that reached the goal, with all sources",
            found=f"{reached} of {len(outcomes)}",
            promised="all",
            met=reached == len(outcomes),
        ),
        Target(
            what="true poses in the ellipsoid that should hold 95 %",
            found=f"{part:.1%}",
            promised=f"{HONEST[0]:.0%} to {HONEST[1]:.1%}",
            met=HONEST[0] <= part <= HONEST[1],
        ),
    )


def source_tables(runs: Sequence[ListedRun], results: Sequence[SourceResult]) -> list[str]:
    """Return the runs, their results, and a row for each choice of sources; none without results."""
    if not results:
        return []
    head = [
        "sources",
        "reached",
        "off, p95",
        "pose off, rms",
        "worst",
        "heading off, rms",
        "in 95 %",
        "bumped",
    ]
    rows = [_cells(name, [r.outcomes[name] for r in results]) for name in results[0].outcomes]
    return [_told(results), targets_markdown(source_targets(results)), markdown(head, rows)]


def _told(results: Sequence[SourceResult]) -> str:
    """Describe the runs."""
    numbers = ", ".join(map(str, sorted({result.key.number for result in results})))
    seeds = ", ".join(map(str, sorted({result.key.seed for result in results})))
    return f"Runs {numbers}; seeds {seeds}."


def _cells(name: str, outcomes: Sequence[SourceOutcome]) -> list[str]:
    errors = [outcome.errors for outcome in outcomes]
    looks = max(sum(one.looks for one in errors), 1)
    rms_mm = math.sqrt(sum(one.square_mm2 for one in errors) / looks)
    rms_deg = math.sqrt(sum(one.square_deg2 for one in errors) / looks)
    reached = [outcome.off_mm for outcome in outcomes if not outcome.failure]
    return [
        name,
        f"{len(reached)}/{len(outcomes)}",
        f"{percentile(reached, 0.95) / 1000:.2f} m" if reached else "",
        f"{rms_mm:,.0f} mm",
        f"{max(one.worst_mm for one in errors):,.0f} mm",
        f"{rms_deg:.2f} deg",
        f"{sum(one.inside for one in errors) / looks:.1%}",
        str(sum(outcome.contact_mm_s > 0.0 for outcome in outcomes)),
    ]


SOURCE_TABLE = Table(name="source", kind=SourceResult, columns=(*KEY_COLUMNS, "origin", "goal", "outcomes"))
"""Runs with different sources."""
