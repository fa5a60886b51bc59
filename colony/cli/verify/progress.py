"""What `colony verify` is at, on a terminal; nothing elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Tell(Protocol):
    """Says how far the work is: how many of how many things are done, and what is done now."""

    def __call__(self, done: int, of: int, now: str) -> None: ...


@contextmanager
def progress() -> Iterator[Tell]:
    """While it lasts, a bar on standard error where that is a terminal; it is taken away in the end."""
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
