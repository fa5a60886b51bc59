"""Progress of many runs on stderr: a bar on a terminal, otherwise a line per tenth of the runs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from colony.cli.reporting import say

ReportRun = Callable[[int, int, str, bool], None]
"""A function that takes the number of finished runs, the total, the latest run as text, and if it is bad."""


@contextmanager
def progress(what: str) -> Iterator[ReportRun]:
    """Report the progress of `what` ("runs") inside the `with`; the bar is removed at the end."""
    bad_ones = 0

    def line(completed: int, total: int, latest: str, is_bad: bool) -> None:
        nonlocal bad_ones
        bad_ones += is_bad
        if completed * 10 // total > (completed - 1) * 10 // total:
            say(f"{100 * completed // total} %: {completed} of {total} {what}, {bad_ones} bad")

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

    def bar(completed: int, total: int, latest: str, is_bad: bool) -> None:
        nonlocal bad_ones
        bad_ones += is_bad
        text = f"{what}, {bad_ones} bad; latest: {latest}"
        display.update(task, completed=completed, total=total, description=text)

    with display:
        yield bar
