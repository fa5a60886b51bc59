"""The progress of `colony verify`, shown only on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class ReportProgress(Protocol):
    """A function that reports progress: the number of finished items, the total, and the current item."""

    def __call__(self, completed: int, total: int, current: str) -> None:
        """Report that `completed` of `total` items are finished, and `current` is in progress."""
        ...


@contextmanager
def progress() -> Iterator[ReportProgress]:
    """Show a progress bar inside the `with` if standard error is a terminal."""
    if not sys.stderr.isatty():
        yield lambda completed, total, current: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    display = Progress(
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
        console=Console(stderr=True),
        transient=True,
    )
    task = display.add_task("", total=None)
    with display:
        yield lambda completed, total, current: display.update(
            task, completed=completed, total=total, description=current
        )
