"""Progress of an experiment on stderr: a bar on a terminal, otherwise a line per tenth of the runs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from colony.cli.reporting import say

R = TypeVar("R")

ReportProgress = Callable[[int, int, R], None]
"""Function that takes the number of finished runs, the total, and the latest result."""


@contextmanager
def progress(
    what: str, is_bad: Callable[[R], bool], describe: Callable[[R], str]
) -> Iterator[ReportProgress[R]]:
    """Report the progress of runs inside the `with`; the bar is removed at the end.

    Args:
        what: what was done to the finished runs: "run", "audited".
        is_bad: function that returns True for a result to be counted as bad.
        describe: function that returns a short description of a result.
    """
    failed = 0

    def line(completed: int, total: int, latest: R) -> None:
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

    def bar(completed: int, total: int, latest: R) -> None:
        nonlocal failed
        failed += is_bad(latest)
        text = f"{what}, {failed} bad; latest: {describe(latest)}"
        display.update(task, completed=completed, total=total, description=text)

    with display:
        yield bar
