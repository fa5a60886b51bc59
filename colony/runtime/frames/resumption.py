"""Resumption of a run by a restarted Clock, or after the leader was away: its epoch goes on.

The Clock learns the epoch from the progress that clients and the observer report (`Ready.progress`). The run
goes on after the last frame that any of them stepped over. Ticks after that frame are abandoned: no memory
depends on them, but the numbers up to them are used up. Nodes that are behind get the reported ticks from the
new Clock, and the frames from the servers.
"""

from __future__ import annotations

from typing import NamedTuple

from colony.runtime.protocol.messages import Progress, Tick


class ResumedEpoch(NamedTuple):
    """The epoch in which a run goes on after the frame `last`.

    `ticks` are known ticks up to that frame, in order. Frames of `behind` were not stepped over by all nodes.
    `used_k` is the highest number in use, and `void` the void frames listed only in abandoned ticks.
    """

    start: int
    last: Tick
    ticks: tuple[Tick, ...]
    behind: tuple[Tick, ...]
    used_k: int
    void: tuple[tuple[str, int], ...]


class Resumption:
    """The progress of the nodes of one run, as far as they have reported it. Mutable."""

    def __init__(self, run: str) -> None:
        self.run = run
        self._reports: dict[str, Progress] = {}

    @property
    def has_begun(self) -> bool:
        """True if the run began before, as far as is known."""
        return bool(self._reports)

    def take(self, address: str, progress: Progress | None) -> None:
        """Take a node's report; a later one replaces it."""
        if progress is not None:
            self._reports[address] = progress

    def epoch(self) -> ResumedEpoch | None:
        """Return the epoch that goes on.

        Return None if the run has not begun, if no node stepped over a frame of the newest epoch, or if the
        tick of the last of these frames is unknown.
        """
        start = max((report.start for report in self._reports.values()), default=-1)
        current = [report for report in self._reports.values() if report.start == start]
        ticks = {tick.k: tick for report in current for tick in report.ticks if tick.start == start}
        last_k = max((report.stepped for report in current), default=-1)
        last = ticks.get(last_k)
        if last is None:
            return None
        known = tuple(ticks[k] for k in sorted(ticks) if k <= last_k)
        least_k = min(r.stepped if r.start == start else start - 1 for r in self._reports.values())
        return ResumedEpoch(
            start=start,
            last=last,
            ticks=known,
            behind=tuple(tick for tick in known if tick.k > least_k),
            used_k=max(ticks),
            void=tuple(dict.fromkeys(v for k in sorted(ticks) if k > last_k for v in ticks[k].void)),
        )
