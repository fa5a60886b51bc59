"""The result of the detection of ceiling lights in a run: as data, in the file of results, and in tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from colony.experiment.results import KEY_COLUMNS, ResultTable, RunKey
from studies.confidence.estimate import Count
from studies.figures import Target, rate
from studies.lights.detection import LightDetection
from studies.lists import ListedRun
from studies.record import FailureReason
from studies.tables import markdown, targets_markdown


@dataclass(frozen=True, slots=True, kw_only=True)
class LightResult:
    """The result of the detection of lights in one run.

    Attributes:
        key: key of the run.
        origin, goal: nodes of the map.
        failure: the reason why the run failed; "" if it reached the goal. Counts up to a failure are valid.
        counts: the counts of lights.
        undetected: positions of the lights that are on and were passed without being reported, x and y in mm.
    """

    key: RunKey
    origin: str
    goal: str
    failure: FailureReason
    counts: LightDetection
    undetected: tuple[tuple[int, int], ...]


def detection_total(results: Sequence[LightResult]) -> LightDetection:
    """Return the counts over runs."""
    counts = [result.counts for result in results]
    return LightDetection(*(sum(column) for column in zip(*counts, strict=True))) if counts else _NO_COUNTS


def light_targets(results: Sequence[LightResult]) -> tuple[Target, ...]:
    """Compare the detection with the promised values."""
    counts = detection_total(results)
    detected = Count(counts.detected, counts.passed)
    return (
        Target(
            what="lights that are on and were passed: detected",
            found=rate(detected),
            promised="at least 0.995",
            met=counts.passed > 0 and detected.successes >= 0.995 * detected.trials,
        ),
        Target(
            what="false lights, of all reported",
            found=rate(Count(counts.false, counts.reported)),
            promised="at most 1 in 1,000",
            met=counts.reported > 0 and 1000 * counts.false <= counts.reported,
        ),
    )


def light_tables(runs: Sequence[ListedRun], results: Sequence[LightResult]) -> list[str]:
    """Return the table of targets, the table with one row per run, and that of undetected lights."""
    if not results:
        return []
    tables = [targets_markdown(light_targets(results)), _run_table(runs, results), _undetected_table(results)]
    return [table for table in tables if table]


def _run_table(runs: Sequence[ListedRun], results: Sequence[LightResult]) -> str:
    rows = []
    for run in runs:
        of_run = [result for result in results if result.key.number == run.number]
        if of_run:
            route = [str(run.number), run.origin, run.goal]
            reached = sum(not result.failure for result in of_run)
            rows.append([*route, f"{reached}/{len(of_run)}", *_cells(detection_total(of_run))])
    rows.append(["all", "", "", "", *_cells(detection_total(results))])
    head = ["run", "from", "to", "reached", "lights detected", "in images", "false, of all reported"]
    return markdown(head, rows)


def _cells(counts: LightDetection) -> list[str]:
    return [
        f"{counts.detected}/{counts.passed}",
        f"{counts.in_view_reported}/{counts.in_view}",
        f"{counts.false}/{counts.reported}",
    ]


def _undetected_table(results: Sequence[LightResult]) -> str:
    rows = [
        [str(result.key.number), str(result.key.seed), f"{x / 1000:.1f}, {y / 1000:.1f}"]
        for result in results
        for x, y in result.undetected
    ]
    return markdown(["run", "seed", "light that was not detected, at x, y in m"], rows) if rows else ""


_NO_COUNTS = LightDetection(0, 0, 0, 0, 0, 0)


_COUNT_COLUMNS = ("passed", "detected", "in_view", "in_view_told", "told", "false")
"""The columns of `LightDetection`."""
LIGHT_TABLE = ResultTable(
    name="lights",
    kind=LightResult,
    columns=(*KEY_COLUMNS, "origin", "goal", "failure", *_COUNT_COLUMNS, "undetected"),
)
"""One row per run; the undetected lights are a JSON list of positions."""
