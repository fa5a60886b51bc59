"""Markdown tables of results, for terminals and pages: our results beside the published ones."""

from __future__ import annotations

from collections.abc import Sequence

from colony.text.wording import one_line
from studies.confidence.published_runs import PublishedRun
from studies.figures import MM_S_TO_M_MIN, Target, percentile, targets
from studies.lists import ListedRun
from studies.record import MODES, RunResult


def table(runs: Sequence[ListedRun], results: Sequence[RunResult]) -> str:
    """Return a table with one row per run, over all of its seeds, beside the published results.

    "Beyond" is the distance beyond the goal along the last leg, as published; it is negative before the goal.
    "Off" is the straight-line distance from the goal.
    """
    published = any(run.published is not None for run in runs)
    by_number: dict[int, list[RunResult]] = {}
    for result in results:
        by_number.setdefault(result.key.number, []).append(result)
    head = ["run", "from", "to", "m", "reached", "beyond, median", "off, p95", "time", "m/min", "L", "C", "D"]
    if published:
        head += ["published: beyond", "time", "m/min", "L", "C", "D"]
    rows = [_row(run, by_number[run.number], published) for run in runs if run.number in by_number]
    return markdown(head, rows)


def target_table(results: Sequence[RunResult], *, published: bool) -> str:
    """Compare the results with the promised values, in Markdown."""
    return targets_markdown(targets(results, published=published))


def targets_markdown(target_list: Sequence[Target]) -> str:
    """Return a table with one row per target."""
    rows = [
        [target.what, target.found, target.promised, "met" if target.met else "**missed**"]
        for target in target_list
    ]
    return markdown(["what", "found", "promised", ""], rows)


def failure_table(results: Sequence[RunResult]) -> str:
    """Return a table of the failed runs; "" for none."""
    rows = [
        [
            str(r.key.number),
            str(r.key.seed),
            r.origin,
            r.goal,
            r.failure,
            r.failed_mode,
            f"{r.goal_error_mm / 1000:.1f} m",
            clock_time(r.time_s),
            r.remark or r.hazards,
        ]
        for r in results
        if not r.reached
    ]
    head = ["run", "seed", "from", "to", "failure", "mode", "off", "after", "remark"]
    return markdown(head, rows) if rows else ""


def clock_time(seconds: float) -> str:
    """Format minutes and seconds, as published: 5:26."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02}"


def _row(run: ListedRun, results: list[RunResult], published: bool) -> list[str]:
    reached = [r for r in results if r.reached]
    cells = [
        str(run.number),
        run.origin,
        run.goal,
        f"{results[0].distance_mm / 1000:.1f}",
        f"{len(reached)}/{len(results)}",
        f"{percentile([r.overshoot_mm for r in reached], 0.5) / 1000:+.2f} m" if reached else "-",
        f"{percentile([r.goal_error_mm for r in reached], 0.95) / 1000:.2f} m" if reached else "-",
        clock_time(percentile([r.time_s for r in reached], 0.5)) if reached else "-",
        f"{percentile([r.mean_mm_s for r in reached], 0.5) * MM_S_TO_M_MIN:.1f}" if reached else "-",
        *_modes(results),
    ]
    return cells + (_published(run.published) if published else [])


def _modes(results: list[RunResult]) -> list[str]:
    """Return for each mode the mean number of completions, and the number required."""
    cells = []
    for index in range(len(MODES)):
        done = sum(r.mode_counts[index].completed for r in results) / len(results)
        cells.append(f"{done:.4g}/{results[0].mode_counts[index].needed}")
    return cells


def _published(run: PublishedRun | None) -> list[str]:
    if run is None:
        return [""] * 6
    letter = run.failed_mode.upper() if run.failed_mode is not None else ""
    modes = [
        f"{done}{'*' if mode == letter else ''}/{needed}"
        for mode, done, needed in zip(MODES, run.completed, run.required, strict=True)
    ]
    if run.beyond_goal_mm is None or run.seconds is None:
        return ["failed", "", "", *modes]
    speed = run.distance_mm / run.seconds * MM_S_TO_M_MIN
    return [f"{run.beyond_goal_mm / 1000:+.3g} m", clock_time(run.seconds), f"{speed:.1f}", *modes]


def markdown(head: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table whose columns are aligned in the text."""
    head, *rows = ([_cell(text) for text in row] for row in (head, *rows))
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    lines = [
        " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in (head, *rows)
    ]
    rule = "|".join("-" * (width + 2) for width in widths)
    return "\n".join([f"| {lines[0]} |", f"|{rule}|", *(f"| {line} |" for line in lines[1:])])


def _cell(text: str) -> str:
    return one_line(text).replace("|", "\\|")
