"""The progress of an experiment on standard error: a bar on a terminal, else a line every tenth."""

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
    """A function that takes the number of finished runs, the number of all runs, and the latest result."""

    def __call__(self, done: int, of: int, latest: AnyResult) -> None:
        """Report that `done` of `of` runs are finished."""
        ...


@contextmanager
def progress(what: str) -> Iterator[ReportProgress]:
    """Report the progress of `what` ("run", "audited") inside the `with`; the bar is removed at the end."""
    failed = 0

    def line(done: int, of: int, latest: AnyResult) -> None:
        nonlocal failed
        failed += is_bad(latest)
        if done * 10 // of > (done - 1) * 10 // of:
            say(f"{100 * done // of} %: {done} of {of} {what}, {failed} bad")

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

    def bar(done: int, of: int, latest: AnyResult) -> None:
        nonlocal failed
        failed += is_bad(latest)
        text = f"{what}, {failed} bad; latest: {described(latest)}"
        display.update(task, completed=done, total=of, description=text)

    with display:
        yield bar


def is_bad(latest: AnyResult) -> bool:
    """Return True if a run failed, or an audit found a difference."""
    return bool(latest.difference if isinstance(latest, AuditedRun) else latest.failure)


def described(latest: AnyResult) -> str:
    """Return a short description of a run."""
    which = f"run {latest.key.number}, seed {latest.key.seed}"
    match latest:
        case AuditedRun():
            return f"{which}, {latest.frames} frames"
        case RunResult():
            return f"{which}, {latest.failure or 'reached'}, {latest.off_mm / 1000:.2f} m off"
        case PlateResult() | LightResult() | SourceResult():
            return f"{which}, {latest.failure or 'reached'}"
        case _:
            assert_never(latest)
