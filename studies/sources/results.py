"""The results of runs with different sources of the pose: as data, in the file of results, and in tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from colony.experiment.results import KEY_COLUMNS, ResultTable, RunKey
from studies.figures import Target, percentile
from studies.lists import ListedRun
from studies.record import FailureReason
from studies.tables import markdown, targets_markdown

ALL_SOURCES, ODOMETRY = "all", "odometry alone"

CONSISTENT_RANGE = (0.85, 0.999)
"""Accepted range of the fraction of true poses inside the 95 % ellipsoid of the estimate.

Within it the covariance is correct within a factor of about two.
"""


class PoseErrors(NamedTuple):
    """Errors of the estimate against the true pose, along a run.

    Attributes:
        comparisons: number of comparisons with the true pose.
        square_mm2: sum of the squared errors of the position.
        square_deg2: sum of the squared errors of the heading.
        worst_mm: maximum error of the position.
        inside: number of true poses inside the 95 % ellipsoid.
    """

    comparisons: int = 0
    square_mm2: float = 0.0
    square_deg2: float = 0.0
    worst_mm: float = 0.0
    inside: int = 0


class SourceOutcome(NamedTuple):
    """The outcome of a run with some of the sources.

    Attributes:
        failure: the reason for a failure; "" if the run reached the goal.
        goal_error_mm: final distance from the goal.
        contact_mm_s: speed of the hardest contact.
        errors: errors of the estimate along the path.
    """

    failure: FailureReason
    goal_error_mm: float
    contact_mm_s: float
    errors: PoseErrors


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceResult:
    """The result of a run that was driven once for each choice of sources.

    Attributes:
        key: key of the run.
        origin, goal: nodes of the map.
        outcomes: the outcomes by the omitted source, such as "no lights"; with `ALL_SOURCES` and `ODOMETRY`.
    """

    key: RunKey
    origin: str
    goal: str
    outcomes: Mapping[str, SourceOutcome]

    @property
    def failure(self) -> FailureReason:
        """The reason why the run with all sources failed."""
        return self.outcomes[ALL_SOURCES].failure


def source_targets(results: Sequence[SourceResult]) -> tuple[Target, ...]:
    """Compare the results with all sources with the promised values."""
    if not results:
        return ()
    outcomes = [result.outcomes[ALL_SOURCES] for result in results]
    comparisons = sum(outcome.errors.comparisons for outcome in outcomes)
    fraction = sum(outcome.errors.inside for outcome in outcomes) / comparisons if comparisons else 0.0
    reached = sum(not outcome.failure for outcome in outcomes)
    return (
        Target(
            what="runs that reached the goal, with all sources",
            found=f"{reached} of {len(outcomes)}",
            promised="all",
            met=reached == len(outcomes),
        ),
        Target(
            what="true poses inside the 95 % ellipsoid",
            found=f"{fraction:.1%}",
            promised=f"{CONSISTENT_RANGE[0]:.0%} to {CONSISTENT_RANGE[1]:.1%}",
            met=CONSISTENT_RANGE[0] <= fraction <= CONSISTENT_RANGE[1],
        ),
    )


def source_tables(runs: Sequence[ListedRun], results: Sequence[SourceResult]) -> list[str]:
    """Return the list of runs, the targets, and a table with one row per choice of sources."""
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
    return [_description(results), targets_markdown(source_targets(results)), markdown(head, rows)]


def _description(results: Sequence[SourceResult]) -> str:
    """Describe the runs."""
    numbers = ", ".join(map(str, sorted({result.key.number for result in results})))
    seeds = ", ".join(map(str, sorted({result.key.seed for result in results})))
    return f"Runs {numbers}; seeds {seeds}."


def _cells(name: str, outcomes: Sequence[SourceOutcome]) -> list[str]:
    errors = [outcome.errors for outcome in outcomes]
    comparisons = max(sum(error.comparisons for error in errors), 1)
    rms_mm = math.sqrt(sum(error.square_mm2 for error in errors) / comparisons)
    rms_deg = math.sqrt(sum(error.square_deg2 for error in errors) / comparisons)
    reached = [outcome.goal_error_mm for outcome in outcomes if not outcome.failure]
    return [
        name,
        f"{len(reached)}/{len(outcomes)}",
        f"{percentile(reached, 0.95) / 1000:.2f} m" if reached else "",
        f"{rms_mm:,.0f} mm",
        f"{max(error.worst_mm for error in errors):,.0f} mm",
        f"{rms_deg:.2f} deg",
        f"{sum(error.inside for error in errors) / comparisons:.1%}",
        str(sum(outcome.contact_mm_s > 0.0 for outcome in outcomes)),
    ]


SOURCE_TABLE = ResultTable(
    name="source", kind=SourceResult, columns=(*KEY_COLUMNS, "origin", "goal", "outcomes")
)
"""Runs with different sources."""
