"""Memory of processes that are killed and started again: a curve for each incarnation, and how they grow."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from statistics import median

WARM_UP_S = 10
"""Seconds after its start at which a process has warmed up; growth counts from there."""

STARTED = 0.75
"""Fraction of its last size at which a process counts as started."""

GROWTH = 8 << 20
"""Bytes that a process may gain after its warm-up: servers keep 2000 frames, which take 100 s to come."""

GROWTH_PER_DEATH = 24 << 10
"""Further bytes for each process killed meanwhile: connections that come and go fragment the heap."""

DRIFT = 3 << 20
"""Bytes by which late incarnations of a process may be larger than early ones."""

NEWEST = 3
"""Number of samples, a second apart, of which the largest counts at each end of a curve."""


def resident(pid: int) -> int:
    """Return the bytes of a process that are in memory; 0 if it is gone."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
    except (FileNotFoundError, ProcessLookupError):
        return 0


class Incarnations:
    """Memory of one process, sampled once a second. Mutable: one curve, in bytes, per process id."""

    def __init__(self) -> None:
        self._pid: int | None = None
        self.curves: list[list[int]] = []

    def sample(self, pid: int | None) -> None:
        """Measure the present process; `pid` is None while there is none."""
        if pid is None:
            return
        if pid != self._pid:
            self._pid = pid
            self.curves.append([])
        size = resident(pid)
        if size:
            self.curves[-1].append(size)

    @property
    def lives(self) -> list[tuple[int, int]]:
        """Length in seconds of each incarnation, and the bytes that it has gained after its warm-up."""
        return [(len(curve), _grown(curve)) for curve in self.curves]

    @property
    def drift(self) -> int:
        """Bytes by which late incarnations are larger than early ones of the same age.

        It compares the medians of the first and the last third; 0 for fewer than six incarnations.
        """
        warm = [(curve, _warm_at(curve)) for curve in self.curves]
        sizes = [max(curve[at : at + NEWEST]) for curve, at in warm if len(curve) >= at + NEWEST]
        third = len(sizes) // 3
        return int(median(sizes[-third:]) - median(sizes[:third])) if third >= 2 else 0

    @property
    def largest(self) -> int:
        """The most bytes that an incarnation had."""
        return max((max(curve, default=0) for curve in self.curves), default=0)


def _grown(curve: list[int]) -> int:
    begin = _warm_at(curve)
    if len(curve) < begin + 2 * NEWEST:
        return 0
    return max(curve[-NEWEST:]) - max(curve[begin : begin + NEWEST])


def _warm_at(curve: list[int]) -> int:
    """Return the index at which a process has warmed up; on a busy machine its start may take long."""
    started = next((i for i, size in enumerate(curve) if size >= STARTED * curve[-1]), 0)
    return started + WARM_UP_S


class Census:
    """Memory of all processes of a run, by name. Mutable: the curves."""

    def __init__(self) -> None:
        self.processes: dict[str, Incarnations] = {}

    def take(self, pids: Mapping[str, int]) -> None:
        """Measure every process that lives now."""
        for name, pid in pids.items():
            self.processes.setdefault(name, Incarnations()).sample(pid)

    @property
    def largest(self) -> int:
        """The most bytes that a process had."""
        return max((process.largest for process in self.processes.values()), default=0)

    def problems(self, deaths_per_s: float) -> Iterator[str]:
        """Yield the processes that grow, while so many are killed in a second."""
        for name, process in self.processes.items():
            for seconds, grown in process.lives:
                if grown > GROWTH + GROWTH_PER_DEATH * deaths_per_s * seconds:
                    yield f"{name} grew by {grown / 2**20:.1f} MB in a life of {seconds} s"
            if process.drift > DRIFT:
                yield f"{name} became larger by {process.drift / 2**20:.1f} MB over its restarts"
