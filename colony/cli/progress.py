"""Progress of long work on standard error: on a terminal a bar, removed at the end; otherwise lines."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING, BinaryIO, Protocol, TypeVar

from colony.cli.reporting import PROGRESS_DELAY_S, say

if TYPE_CHECKING:
    from colony.runtime.frames.run_frame import RunFrame

REPORT_INTERVAL_NS = 10_000_000_000
"""Nanoseconds between two progress reports of a run without a fixed length."""

R = TypeVar("R")

ReportResult = Callable[[int, int, R], None]
"""Function that takes the number of finished runs, the total, and the latest result."""


class ReportProgress(Protocol):
    """A function that reports progress: the number of finished items, the total, and the current item."""

    def __call__(self, completed: int, total: int, current: str) -> None:
        """Report that `completed` of `total` items are finished, and `current` is in progress."""
        ...


class ProgressPause(Protocol):
    """A function that returns a context in which nothing of the progress is on the screen."""

    def __call__(self) -> AbstractContextManager[None]:
        """Return the context."""
        ...


class ReadingProgress:
    """Reports each tenth of a file that is read, if reading takes long. Stateful."""

    def __init__(self, file: BinaryIO, label: str = "") -> None:
        self._file, self._label = file, label
        self._size = os.fstat(file.fileno()).st_size
        self._since = time.monotonic()
        self._tenths = 0

    def __call__(self) -> None:
        """Report the progress, if it has reached another tenth."""
        tenths = 10 * self._file.tell() // max(self._size, 1)
        if tenths > self._tenths:
            self._tenths = tenths
            if tenths < 10 and time.monotonic() - self._since > PROGRESS_DELAY_S:
                say(f"{self._label}{10 * tenths} %")


class RunProgress:
    """A sink that reports the progress of a run. Stateful: remembers the last report.

    A run of fixed length prints a line per tenth, another one a line every `REPORT_INTERVAL_NS`.

    Args:
        length_ns: length of the run; None if it is not fixed.
    """

    def __init__(self, length_ns: int | None) -> None:
        self._length_ns = length_ns
        self._interval_ns = REPORT_INTERVAL_NS if length_ns is None else length_ns / 10
        self._intervals = 0
        self._bar = _Bar(counted=False) if sys.stderr.isatty() else None

    def take(self, log: RunFrame) -> None:
        """Report the progress, if it has changed enough."""
        self.show(log.tick.t_ns, lambda: _run_text(log))

    def show(self, t_ns: int, text: Callable[[], str]) -> None:
        """Report that the run has come to this time."""
        if self._bar is not None:
            self._bar.show(t_ns, self._length_ns, text())
            return
        intervals = int(t_ns // self._interval_ns)
        if intervals > self._intervals:
            self._intervals = intervals
            say(text() if self._length_ns is None else f"{10 * intervals} %: {text()}")

    def close(self) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.close()


def _run_text(log: RunFrame) -> str:
    """Return the time and who commands what; verdicts come in any order, so the names are sorted."""
    commanders = ", ".join(
        f"{name} by {verdict.by or verdict.outside or 'nobody'}"
        for name, verdict in sorted(log.verdicts.items())
    )
    return f"{log.tick.t_ns / 1e9:.1f} s, {commanders}"


@contextmanager
def proof_progress() -> Iterator[tuple[ReportProgress, ProgressPause]]:
    """Show the progress of proofs inside the `with`, on a terminal only."""
    if not sys.stderr.isatty():
        yield (lambda completed, total, current: None), nullcontext
        return
    bar = _Bar()
    try:
        yield bar.show, bar.pause
    finally:
        bar.close()


@contextmanager
def experiment_progress(
    what: str, is_bad: Callable[[R], bool], describe: Callable[[R], str]
) -> Iterator[ReportResult[R]]:
    """Report the progress of runs inside the `with`: without a terminal, a line per tenth of the runs.

    Args:
        what: what was done to the finished runs: "run", "audited".
        is_bad: function that returns True for a result to be counted as bad.
        describe: function that returns a short description of a result.
    """
    failed = 0
    bar = _Bar() if sys.stderr.isatty() else None

    def report(completed: int, total: int, latest: R) -> None:
        nonlocal failed
        failed += is_bad(latest)
        if bar is not None:
            bar.show(completed, total, f"{what}, {failed} bad; latest: {describe(latest)}")
        elif completed * 10 // total > (completed - 1) * 10 // total:
            say(f"{100 * completed // total} %: {completed} of {total} {what}, {failed} bad")

    try:
        yield report
    finally:
        if bar is not None:
            bar.close()


class _Bar:
    """A progress bar. Mutable. Only a terminal needs `rich`, which is imported here.

    Args:
        counted: True to show the number of finished items, False to show percent.
    """

    def __init__(self, *, counted: bool = True) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TaskProgressColumn,
            TextColumn,
            TimeElapsedColumn,
        )

        self._display = Progress(
            BarColumn(),
            MofNCompleteColumn() if counted else TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.description}"),
            console=Console(stderr=True),
            transient=True,
        )
        self._task = self._display.add_task("", total=None)
        self._display.start()

    def show(self, completed: float, total: float | None, current: str) -> None:
        self._display.update(self._task, completed=completed, total=total, description=current)

    @contextmanager
    def pause(self) -> Iterator[None]:
        self._display.stop()
        yield
        self._display.start()

    def close(self) -> None:
        self._display.stop()
