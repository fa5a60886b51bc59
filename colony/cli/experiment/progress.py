"""Progress of an experiment on stderr: a bar on a terminal, otherwise a line per tenth of the runs."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, assert_never

from colony.cli.reporting import say
from colony.experiment.auditing import AuditedRun
from colony.experiment.lights.results import LightResult
from colony.experiment.plates.record import PlateResult
from colony.experiment.record import RunResult
from colony.experiment.sources.results import SourceResult

AnyResult = RunResult | AuditedRun | PlateResult | LightResult | SourceResult


class ReportProgress(Protocol):
    """A function that takes the number of finished runs, the total, and the latest result."""

    def __call__(self, completed: int, total: int, latest: AnyResult) -> None:
        """Report that `completed` of `total` runs are finished."""
        ...


@contextmanager
def progress(what: str) -> Iterator[ReportProgress]:
    """Report the progress of `what` ("run", "audited") inside the `with`; the bar is removed at the end."""
    failed = 0

    def line(completed: int, total: int, latest: AnyResult) -> None:
        nonlocal failed
        failed += is_bad(latest)
        if completed * 10 // total > (completed - 1) * 10 // total:
            say(f"{100 * completed // total} %: {completed} of {total} {what}, {failed} bad")

    if not sys.stderr.isatty():
        yield line
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    display = Progress(
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
        console=Console(stderr=True),
        transient=True,
    )
    task = display.add_task(what, total=None)

    def bar(completed: int, total: int, latest: AnyResult) -> None:
        nonlocal failed
        failed += is_bad(latest)
        text = f"{what}, {failed} bad; latest: {describe(latest)}"
        display.update(task, completed=completed, total=total, description=text)

    with display:
        yield bar


def is_bad(latest: AnyResult) -> bool:
    """Return True if a run failed, or an audit found a difference."""
    return bool(latest.difference if isinstance(latest, AuditedRun) else latest.failure)


def describe(latest: AnyResult) -> str:
    """Return a short description of a run."""
    run = f"run {latest.key.number}, seed {latest.key.seed}"
    match latest:
        case AuditedRun():
            return f"{run}, {latest.frames} frames"
        case RunResult():
            return f"{run}, {latest.failure or 'reached'}, {latest.goal_error_mm / 1000:.2f} m off"
        case PlateResult() | LightResult() | SourceResult():
            return f"{run}, {latest.failure or 'reached'}"
        case _:
            assert_never(latest)
