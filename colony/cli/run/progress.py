"""Progress of a run on standard error: a bar on a terminal, otherwise lines.

A run of fixed length prints a line per tenth, another one a line every `REPORT_INTERVAL_NS`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

from colony.cli.reporting import say
from colony.runtime.frames.run_frame import RunFrame

REPORT_INTERVAL_NS = 10_000_000_000
"""Nanoseconds between two progress reports of a run without a fixed length."""


class Progress:
    """A sink that reports the progress of a run. Stateful: remembers the last report.

    On a terminal it shows a progress bar, which is removed at the end. Only then is `rich` imported.

    Args:
        length_ns: length of the run; None if it is not fixed.
    """

    def __init__(self, length_ns: int | None) -> None:
        self._length_ns = length_ns
        self._interval_ns = REPORT_INTERVAL_NS if length_ns is None else length_ns / 10
        self._intervals = 0
        self._bar = _Bar(length_ns) if sys.stderr.isatty() else None

    def take(self, log: RunFrame) -> None:
        """Report the progress, if it has changed enough."""
        self.show(log.tick.t_ns, lambda: _progress_text(log))

    def show(self, t_ns: int, text: Callable[[], str]) -> None:
        """Report that the run has come to this time."""
        if self._bar is not None:
            self._bar.show(t_ns, text())
            return
        intervals = int(t_ns // self._interval_ns)
        if intervals > self._intervals:
            self._intervals = intervals
            say(text() if self._length_ns is None else f"{10 * intervals} %: {text()}")

    def close(self) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.stop()


def _progress_text(log: RunFrame) -> str:
    """Return the time and who commands what; verdicts come in any order, so the names are sorted."""
    commanders = ", ".join(
        f"{name} by {verdict.by or verdict.outside or 'nobody'}"
        for name, verdict in sorted(log.verdicts.items())
    )
    return f"{log.tick.t_ns / 1e9:.1f} s, {commanders}"


class _Bar:
    """A progress bar. Mutable."""

    def __init__(self, length_ns: int | None) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Display

        self._display = Display(
            BarColumn(),
            TaskProgressColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.description}"),
            console=Console(stderr=True),
            transient=True,
        )
        self._task = self._display.add_task("", total=length_ns)
        self._display.start()

    def show(self, t_ns: int, text: str) -> None:
        self._display.update(self._task, completed=t_ns, description=text)

    def stop(self) -> None:
        self._display.stop()
