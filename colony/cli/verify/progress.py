"""The progress of `colony verify`, shown only on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class ReportProgress(Protocol):
    """A function that reports progress: finished items, all items, and the current one."""

    def __call__(self, done: int, of: int, now: str) -> None:
        """Report that `done` of `of` items are finished, and that `now` is the current one."""
        ...


@contextmanager
def progress() -> Iterator[ReportProgress]:
    """Show a bar inside the `with` if standard error is a terminal; it is removed at the end."""
    if not sys.stderr.isatty():
        yield lambda done, of, now: None
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
        yield lambda done, of, now: display.update(task, completed=done, total=of, description=now)
