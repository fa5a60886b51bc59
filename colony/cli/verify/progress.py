"""The progress of `colony verify`, shown only on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Protocol


class ReportProgress(Protocol):
    """A function that reports progress: the number of finished items, the total, and the current item."""

    def __call__(self, completed: int, total: int, current: str) -> None:
        """Report that `completed` of `total` items are finished, and `current` is in progress."""
        ...


class Pause(Protocol):
    """A function that returns a context in which nothing of the progress is on the screen."""

    def __call__(self) -> AbstractContextManager[None]:
        """Return the context."""
        ...


@contextmanager
def progress() -> Iterator[tuple[ReportProgress, Pause]]:
    """Show a progress bar inside the `with` if standard error is a terminal."""
    if not sys.stderr.isatty():
        yield (lambda completed, total, current: None), nullcontext
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

    @contextmanager
    def pause() -> Iterator[None]:
        display.stop()
        yield
        display.start()

    def report(completed: int, total: int, current: str) -> None:
        display.update(task, completed=completed, total=total, description=current)

    with display:
        yield report, pause
