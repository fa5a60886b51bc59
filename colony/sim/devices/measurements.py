"""When the devices of a robot measure, and when their measurements arrive.

What has a period is measured at the end of the first step in each of its periods. What has none is measured
when it is read or, if readings arrive late or have faults, at the end of each step. A measurement is given
from the time at which it arrives until the next one arrives. While a device is frozen, it takes none; while
its readings are missing, what it takes is that there is nothing. None of this depends on when anything was
read before.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Generic, TypeVar

from colony.sim.devices.faults import Fault, FaultTimeline
from colony.sim.mechanism import Measurement
from colony.sim.physics import Physics

T = TypeVar("T")


class _Schedule:
    """The names that are measured with one period. Mutable: the next one begins at `due_ns`."""

    def __init__(self, period_ns: int) -> None:
        self.period_ns = period_ns
        self.names: list[str] = []
        self.due_ns = 0


class Measurements(Generic[T]):
    """Measurements of a robot in a world, by name. Stateful: keeps those that have arrived or are underway.

    Args:
        take: function that takes a measurement of the world as it is now, by name.
        periods_ns: the period of each name; None for one that is measured whenever it is read.
        world: the world.
        robot: the number of the robot; what is measured arrives after the delay of its readings.
        faults: when nothing is measured, or nothing new; None if there is no such time.

    Attributes:
        scheduled: the names that are measured at the ends of steps, and not when they are read.
        arrived: the newest measurements of these, with the world's times at which they were taken.
    """

    def __init__(
        self,
        take: Callable[[str], Measurement[T]],
        periods_ns: Mapping[str, int | None],
        world: Physics,
        robot: int,
        faults: FaultTimeline | None = None,
    ) -> None:
        self._take = take
        self._world = world
        self._delay_ns = world.configs[robot].reading_delay_ns
        self._faults = faults
        self._underway: deque[tuple[int, dict[str, tuple[Measurement[T], int] | None]]] = deque()
        self.arrived: dict[str, tuple[Measurement[T], int]] = {}
        each_step_ns = 1 if self._delay_ns or faults is not None else None
        schedules: dict[int, _Schedule] = {}
        for name, period_ns in periods_ns.items():
            step_or_period_ns = each_step_ns if period_ns is None else period_ns
            if step_or_period_ns is not None:
                schedules.setdefault(step_or_period_ns, _Schedule(step_or_period_ns)).names.append(name)
        self._schedules = tuple(schedules.values())
        self.scheduled = frozenset(name for schedule in self._schedules for name in schedule.names)
        self._due_ns = 0
        if schedules:
            self._measure()
            world.on_step(self._measure)

    def newest(self, name: str) -> tuple[T, int] | None:
        """Return what was measured last of what has arrived, and its age in ns; None if there is nothing."""
        if name not in self.scheduled:
            return self._take(name)(), 0
        if name not in self.arrived:
            return None
        measurement, taken_ns = self.arrived[name]
        return measurement(), self._world.elapsed_ns - taken_ns

    def _measure(self) -> None:
        """Measure what is due, and receive what has arrived."""
        elapsed_ns = self._world.elapsed_ns
        if elapsed_ns >= self._due_ns:
            fault = None if self._faults is None else self._faults.at(elapsed_ns)
            for schedule in self._schedules:
                if elapsed_ns >= schedule.due_ns:
                    schedule.due_ns = (elapsed_ns // schedule.period_ns + 1) * schedule.period_ns
                    if fault is not Fault.FROZEN:
                        taken = {
                            name: None if fault is Fault.MISSING else (self._take(name), elapsed_ns)
                            for name in schedule.names
                        }
                        self._underway.append((elapsed_ns + self._delay_ns, taken))
            self._due_ns = min(schedule.due_ns for schedule in self._schedules)
        while self._underway and self._underway[0][0] <= elapsed_ns:
            for name, measurement in self._underway.popleft()[1].items():
                if measurement is None:
                    self.arrived.pop(name, None)
                else:
                    self.arrived[name] = measurement
